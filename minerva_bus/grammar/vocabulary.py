"""Vocabularies: the symbols and event types of a world, and the check of strings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from operator import is_
from typing import ClassVar, Protocol, TypeVar

from minerva_bus.errors import MisuseError, VocabularyError, nearest
from minerva_bus.grammar.columns import Columns, fits, packed, rewritten
from minerva_bus.grammar.condition import Scope, parse_condition
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import UniqueIds, invalid_id, no_id
from minerva_bus.grammar.parser import Parsed, parse_located
from minerva_bus.grammar.scene import (
    AgentNode,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
    rebuild,
)
from minerva_bus.grammar.symbols import AgentKind, EventType, Primitive, Transformation
from minerva_bus.grammar.types import Unfit


class HasKind(Protocol):
    """A class of agents, which has a kind."""

    kind: ClassVar[AgentKind]


Entry = Primitive | Transformation | AgentKind | EventType
_E = TypeVar("_E", Primitive, Transformation, AgentKind, EventType)


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The alphabets P, T, A and the event types D of a world.

    Attributes:
        primitives, transformations, kinds, events: the symbols, by name.

    Example:
        >>> vocabulary = Vocabulary.of(PSnail, TAt, Fox, eHunger, ePicture)
        >>> print(vocabulary.read("TAt<x=1, y=150cm>(PSnail)"))
        TAt<x=1, y=1.5>(PSnail)

    """

    primitives: Mapping[str, Primitive] = field(default_factory=dict[str, Primitive])
    transformations: Mapping[str, Transformation] = field(default_factory=dict[str, Transformation])
    kinds: Mapping[str, AgentKind] = field(default_factory=dict[str, AgentKind])
    events: Mapping[str, EventType] = field(default_factory=dict[str, EventType])

    @staticmethod
    def of(*entries: Entry | type[HasKind]) -> Vocabulary:
        """A vocabulary of these symbols, agent classes and event types. Raises MisuseError."""
        plain = [_entry(entry) for entry in entries]
        made = Vocabulary(
            _named(Primitive, plain),
            _named(Transformation, plain),
            _named(AgentKind, plain),
            _named(EventType, plain),
        )
        check_declarations(made)
        return made

    def __contains__(self, name: str) -> bool:
        return any(name in table for table in (self.symbols(name[:1]), self.events))

    def symbols(self, letter: str) -> Mapping[str, Primitive | Transformation | AgentKind]:
        """The symbols whose names begin with P, T or A, by name."""
        if letter == "P":
            return self.primitives
        return self.transformations if letter == "T" else self.kinds

    def fields(self, symbol: str) -> Fields:
        """Parameters or state of a symbol. Raises Unfit for an unknown one."""
        entry = (
            self.kinds.get(symbol)
            or self.transformations.get(symbol)
            or self.primitives.get(symbol)
        )
        if entry is None:
            known = [*self.primitives, *self.transformations, *self.kinds]
            raise Unfit(f"the vocabulary has no {symbol}{nearest(symbol, known)}")
        return entry.fields

    def read(self, text: str, source: str = "") -> Scene:
        """The string that a text represents, checked and completed with defaults.

        Args:
            text: a string of L(M).
            source: name of the file, for errors.

        Raises:
            GrammarError: it is not in L(M); with line, column and caret.
            VocabularyError: an unknown symbol, or a value of a wrong type.

        """
        parsed = parse_located(text, source)
        return self.check(parsed.scene, source, parsed)

    def check(self, scene: Scene, source: str = "", parsed: Parsed | None = None) -> Scene:
        """The string in canonical form: known symbols, typed values in order, defaults filled in.

        Nodes that already have this form are shared. Raises VocabularyError, also for repeated ids.
        """
        # In an in-process run this is the only check of what leaves a member, including nodes that
        # user code has built by hand. Strings within values have ids of their own, so each has its
        # own set.
        taken = UniqueIds()

        def leave(node: Node, scope: Scene) -> Node:
            try:
                if isinstance(node, AgentNode):
                    taken.add(node.id)
                return self._node(node, scope, source, parsed)
            except Unfit as unfit:
                raise _vocabulary_error(str(unfit), node, source, parsed) from None

        def whole(part: Columns) -> Scene:
            # The usual case: checked as arrays, without creating a node for each row.
            if self._fits(part):
                return Scene((self._with_known_ids(part, taken, source),))
            # As nodes, because `leave` completes them, or names the first wrong one.
            return packed(rebuild(Scene(part.nodes()), leave))

        return rewritten(scene, leave, whole)

    def _fits(self, part: Columns) -> bool:
        """Whether columns conform to this vocabulary, except for the form of their ids."""
        if part.ids is not None and part.ids.too_long:
            return False
        for level in part.levels():
            entry = self.symbols(level.symbol[:1]).get(level.symbol)
            if entry is None or entry.fields.names != level.names:
                return False
            if (level.symbol[:1] == "A") != (level.ids is not None):
                return False
            # Only a transformation may have a scope here.
            if (level.symbol[:1] == "T") < (level.scope is not None):
                return False
            if not all(
                map(fits, [parameter.type for parameter in entry.fields.all], level.columns)
            ):
                return False
        return True

    def _with_known_ids(self, part: Columns, taken: UniqueIds, source: str) -> Columns:
        if part.ids is not None:
            try:
                taken.add_all(part.ids)
            except Unfit as unfit:
                raise VocabularyError(str(unfit), source=source) from None
        return part

    def _node(self, node: Node, scope: Scene, source: str, parsed: Parsed | None) -> Node:
        # User code can create nodes directly, also of the wrong class.
        if type(node) is not _NODES.get(node.symbol[:1], type(node)):
            raise Unfit(f"{node.symbol} is not a symbol of {type(node).__name__}")
        fields = self.fields(node.symbol)
        names, values = node.names, node.values
        # Otherwise it is as it left its agent, in this process.
        if not (type(node) is AgentNode and node.fits(fields)):
            owner = f"{node.symbol}#{node.id}" if isinstance(node, AgentNode) else node.symbol
            names, values = fields.refit(owner, names, values)
        if fields.holding_strings:  # These are checked as a whole.
            values = self._inner(fields, values, source, parsed)
        same = names is node.names and values is node.values
        if isinstance(node, FigureNode):
            return node if same else FigureNode(node.symbol, names, values)
        if same and scope is node.scope:
            return node
        if isinstance(node, TransformationNode):
            return TransformationNode(node.symbol, names, values, scope)
        return AgentNode(node.symbol, node.id, names, values, scope)

    def _inner(
        self, fields: Fields, values: tuple[Value, ...], source: str, parsed: Parsed | None = None
    ) -> tuple[Value, ...]:
        """Values with their strings in canonical form; the same objects if they already are."""
        checked = list(values)
        for place in fields.holding_strings:
            checked[place] = self._inner_value(values[place], source, parsed)
        return values if all(map(is_, checked, values)) else tuple(checked)

    def _inner_value(self, value: Value, source: str, parsed: Parsed | None) -> Value:
        if isinstance(value, Scene):
            return self.check(value, source, parsed)
        if not isinstance(value, tuple):
            return value
        checked = tuple([self._inner_value(item, source, parsed) for item in value])
        return value if all(map(is_, checked, value)) else checked

    def check_event(self, event: Event, source: str = "") -> Event:
        """The event in canonical form. Raises VocabularyError."""
        declared = self.events.get(event.type)
        if declared is None:
            known = nearest(event.type, list(self.events), "add it to the vocabulary")
            problem = f"the world has no event type {event.type}{known}"
            raise VocabularyError(problem, source=source)
        try:
            names, values = declared.fields.refit(event.type, event.names, event.values)
        except Unfit as unfit:
            raise VocabularyError(str(unfit), source=source) from None
        if declared.fields.holding_strings:
            values = self._inner(declared.fields, values, source)
        if event.condition:
            self.check_condition(event.type, event.condition, source)
        odd = invalid_id(event.receivers) if event.receivers else None
        if odd is not None:
            raise VocabularyError(f"receivers of {event.type}: {no_id(odd)}", source=source)
        receivers = event.receivers if len(event.receivers) < 2 else _in_order(event.receivers)
        if names is event.names and values is event.values and receivers is event.receivers:
            return event
        return Event(event.type, names, values, event.condition, event.sender, receivers)

    def check_condition(self, event_type: str, text: str, source: str = "") -> None:
        """Raise VocabularyError, with a caret, if no agent can fulfil a condition of an event type.

        Some kind that responds to the type must have its attributes, with matching sorts.
        """
        where = f"{source}: condition" if source else "condition"
        scopes = [
            Scope(kind.name, kind.fields.names, kind.sort_of)
            for kind in self.kinds.values()
            if event_type in kind.subscribes or event_type in kind.views
        ]
        parse_condition(text, where).check(scopes, where)

    def check_any(self, event: AnyEvent, source: str = "") -> AnyEvent:
        """An event or a batch in canonical form. Raises VocabularyError."""
        if isinstance(event, Events):
            return self.check_events(event, source)
        return self.check_event(event, source)

    def check_events(self, events: Events, source: str = "") -> Events:
        """A batch in canonical form. Raises VocabularyError."""
        declared = self.events.get(events.type)
        if (
            declared is None
            or declared.fields.names != events.names
            or not all(
                map(fits, [parameter.type for parameter in declared.fields.all], events.columns)
            )
        ):
            # One by one, so that an error names the event, or values are converted.
            columns = Events.of([self.check_event(event, source) for event in events])
            if columns is None:
                raise VocabularyError(f"a batch of {events.type} cannot be columns", source=source)
            return columns
        if events.condition:
            self.check_condition(events.type, events.condition, source)
        # The columns are valid; ids and the condition are checked apart from them.
        for ids in (events.senders, events.receivers):
            if ids is not None and ids.strange is not None:
                raise VocabularyError(no_id(ids.strange), source=source)
        return events


_NODES = {"P": FigureNode, "T": TransformationNode, "A": AgentNode}


def _entry(entry: Entry | type[HasKind]) -> Entry:
    if isinstance(entry, Entry):
        return entry
    kind: object = getattr(entry, "kind", None)
    if not isinstance(kind, AgentKind):
        raise MisuseError(
            f"{entry!r} cannot be in a vocabulary; expected primitives, transformations, event"
            ' types and agent classes with a symbol, such as class Fox(Agent, symbol="AFox")'
        )
    return kind


def _in_order(receivers: tuple[str, ...]) -> tuple[str, ...]:
    # Receivers are a set; in one order, equal events compare equal.
    ordered = tuple(sorted(set(receivers)))
    return receivers if ordered == receivers else ordered


def _named(kind: type[_E], entries: Iterable[Entry]) -> dict[str, _E]:
    named: dict[str, _E] = {}
    for entry in entries:
        if isinstance(entry, kind):
            if entry.name in named:
                raise MisuseError(f"{entry.name} is declared twice in the vocabulary")
            named[entry.name] = entry
    # Sorted, so that the order of declarations does not matter.
    return dict(sorted(named.items()))


def _vocabulary_error(
    problem: str, node: Node, source: str, parsed: Parsed | None
) -> VocabularyError:
    if parsed is None or id(node) not in parsed.offsets:
        return VocabularyError(problem, source=source)
    offset = parsed.offsets[id(node)]
    return VocabularyError(problem, text=parsed.text, offset=offset, source=source)


def check_declarations(vocabulary: Vocabulary) -> None:
    """Raise MisuseError if entries of a vocabulary do not agree.

    Its tables are complete, because entries refer to each other in any order.
    """
    for kind in vocabulary.kinds.values():
        _check_events_of(kind, vocabulary)
    for symbols in (vocabulary.primitives, vocabulary.transformations, vocabulary.kinds):
        for symbol in symbols.values():
            _check_unlimited(symbol.name, symbol.fields)
    for event_type in vocabulary.events.values():
        _check_sources_of(event_type, vocabulary)
        _check_orders_of(event_type, vocabulary)


def _check_events_of(kind: AgentKind, vocabulary: Vocabulary) -> None:
    for is_view, event_types in ((False, kind.subscribes), (True, kind.views)):
        for event_type in sorted(event_types):
            declared = vocabulary.events.get(event_type)
            if declared is None:
                known = nearest(event_type, list(vocabulary.events))
                raise MisuseError(
                    f"{kind.name} responds to the unknown event type {event_type}{known}"
                )
            if declared.visual != is_view:
                how = "visual: use @view" if declared.visual else "not visual: use @on"
                raise MisuseError(f"{kind.name} responds to {event_type}, which is {how}")


def _check_unlimited(owner: str, fields: Fields) -> None:
    for parameter in fields.all:
        if parameter.type.range is not None or parameter.type.source is not None:
            raise MisuseError(
                f"{owner}: {parameter.name} is a {parameter.type}; only data of event types have a"
                " range or a source"
            )


def _check_sources_of(event_type: EventType, vocabulary: Vocabulary) -> None:
    for parameter in event_type.fields.all:
        of = parameter.type.source
        if of is None:
            continue
        table = vocabulary.symbols(of.symbol[:1])
        names = table[of.symbol].fields.names if of.symbol in table else ()
        if of.parameter not in names:
            every = [f"{name}.{own}" for name in table for own in table[name].fields.names]
            raise MisuseError(
                f"{event_type.name}: {parameter.name} is a text of {of}, which the vocabulary"
                f" does not have{nearest(str(of), every)}"
            )


def _check_orders_of(event_type: EventType, vocabulary: Vocabulary) -> None:
    """Check the types of the orders that agents end with an event."""
    for order in (*event_type.completes, *event_type.fails, *event_type.replaces):
        if order not in vocabulary.events:
            raise MisuseError(
                f"{event_type.name} ends orders {order!r}, an event type that the"
                f" vocabulary does not have{nearest(order, list(vocabulary.events))}"
            )
