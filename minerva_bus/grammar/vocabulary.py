"""The alphabets of a world: primitives P, transformations T, agent kinds A^D_ST, event types D.

A `Vocabulary` has them all, and checks strings and events.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import is_
from typing import Any, ClassVar, Protocol, TypeAlias, TypeVar, cast

import numpy as np

from minerva_bus.errors import MisuseError, VocabularyError, nearest
from minerva_bus.grammar.appearance import Form, Motion, Shape, parameters_of
from minerva_bus.grammar.columns import Columns, around_each, fits, is_array, packed, rewritten
from minerva_bus.grammar.condition import NUMBER, Scope, parse_condition, sort_of_kind
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.fields import NAME, Fields
from minerva_bus.grammar.ids import Ids, UniqueIds, invalid_id, no_id
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
from minerva_bus.grammar.types import Unfit
from minerva_bus.values import text


def _check_form(owner: str, form: Form | None, fields: Fields) -> None:
    if form is not None and not isinstance(form, Form):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(
            f"the form of {owner} must be one of minerva_bus, such as Disc() or Motion(x='x'), not"
            f" {form!r:.60}"
        )
    for name in parameters_of(form) if form is not None else ():
        if name not in fields.names:
            raise MisuseError(
                f"the form of {owner} uses {name}, which is not one of its parameters"
                f"{nearest(name, list(fields.names))}"
            )


def _checked(name: str, alphabet: str, letter: str) -> str:
    if not (isinstance(name, str) and NAME.fullmatch(name)) or name[0] != letter:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(
            f"the name of {alphabet} must be {letter} followed by letters (A to Z), digits or _,"
            f" not {name!r}"
        )
    return name


class Primitive:
    """A primitive p ∈ P; calling it returns the string of one figure.

    If parameters are arrays of shape (n,), it returns n figures, one for each row.

    Args:
        name: begins with P.
        shape: how pictures and windows draw it, such as `Disc`; None: only geometric systems with a
            method of this name do.
        parameters: names with types, such as `size=Metres`, or with `Default(type, value)`.

    Raises:
        MisuseError: an invalid name or type, or a shape that names no parameter.

    Example:
        >>> PSpot = Primitive("PSpot", Disc("size"), size=Metres)
        >>> print(PSpot(size=0.2))
        PSpot<size=0.2>

    """

    def __init__(self, name: str, /, shape: Shape | None = None, **parameters: Any) -> None:
        self.name = _checked(name, "a primitive", "P")
        self.shape = shape
        self.fields = Fields.of(parameters)
        _check_form(name, shape, self.fields)

    def __call__(self, /, *args: Any, **kwargs: Any) -> Scene:
        if any(map(is_array, (*args, *kwargs.values()))):
            return Scene((self.fields.bind_columns(self.name, args, kwargs),))
        values = self.fields.bind(self.name, args, kwargs)
        return Scene((FigureNode(self.name, self.fields.names, values),))

    def __repr__(self) -> str:
        return f"<primitive {self.name}>"


class Transformation:
    """A transformation t ∈ T; `t(parameters)(string, ...)` returns the string t(OBJECTS).

    If parameters are arrays of shape (n,), it returns n transformations, each around its row of
    the scope if the scope has n rows, otherwise around the whole scope.

    Args:
        name: begins with T.
        motion: how pictures and windows move what is in its scope; None: not at all.
        parameters: names with types, such as `x=Metres`, or with `Default(type, value)`.

    Raises:
        MisuseError: an invalid name or type, or a motion that names no parameter.

    Example:
        >>> TAt = Transformation("TAt", Motion(x="x", y="y"), x=Metres, y=Metres)
        >>> print(TAt(1, 2)(PSnail()))
        TAt<x=1, y=2>(PSnail)

    """

    def __init__(self, name: str, /, motion: Motion | None = None, **parameters: Any) -> None:
        self.name = _checked(name, "a transformation", "T")
        self.motion = motion
        self.fields = Fields.of(parameters)
        _check_form(name, motion, self.fields)

    def __call__(self, /, *args: Any, **kwargs: Any) -> OpenTransformation:
        if any(map(is_array, (*args, *kwargs.values()))):
            return OpenTransformation(self, (), self.fields.bind_columns(self.name, args, kwargs))
        return OpenTransformation(self, self.fields.bind(self.name, args, kwargs))

    def __repr__(self) -> str:
        return f"<transformation {self.name}>"


@dataclass(frozen=True, slots=True)
class OpenTransformation:
    """A transformation with its parameters, which takes its scope when it is called."""

    transformation: Transformation
    values: tuple[Value, ...]
    columns: Columns | None = None

    def __call__(self, *scope: Scene) -> Scene:
        name, fields = self.transformation.name, self.transformation.fields
        for node in scope:
            if not isinstance(node, Scene):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise MisuseError(
                    f"the scope of {name} takes strings, not {node!r}; call a primitive once and a"
                    " transformation twice to get a string"
                )
        inside = Scene(tuple([piece for node in scope for piece in node.pieces]))
        if self.columns is not None:
            return around_each(self.columns, inside)
        return Scene((TransformationNode(name, fields.names, self.values, inside),))

    def __repr__(self) -> str:
        return f"<transformation {self.transformation.name} without its scope>"


@dataclass(frozen=True, slots=True)
class AgentKind:
    """A kind of agents a^D_ST: its state's attributes and the event types it responds to.

    `subscribes` are the event types of its activities, `views` those of its views. `chances` are
    the h of a^{d,h} (section 5): the types that it responds to with a probability, by name, each
    with a number from 0 to 1 or the name of an attribute that has it. `rest` names the attributes
    that are commands, which are neutral while the agent is at rest.
    """

    name: str
    fields: Fields
    subscribes: frozenset[str] = frozenset()
    views: frozenset[str] = frozenset()
    chances: tuple[tuple[str, float | str], ...] = ()
    rest: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _checked(self.name, "an agent kind", "A")
        for attribute in self.rest:
            self._check_rest(attribute)
        for event_type, probability in self.chances:
            if event_type not in self.subscribes:
                raise MisuseError(
                    f"{self.name} has a probability for {event_type}, but does not respond to it"
                )
            self._check_chance(event_type, probability)

    def _check_chance(self, event_type: str, probability: float | str) -> None:
        if isinstance(probability, str):
            if self.sort_of(probability) != NUMBER:
                raise MisuseError(
                    f"{self.name} responds to {event_type} with the probability {probability!r};"
                    " expected the name of an attribute that is a number"
                    f"{nearest(probability, list(self.fields.names))}"
                )
        elif not 0 <= probability <= 1:
            raise MisuseError(
                f"{self.name} responds to {event_type} with the probability {probability:g};"
                " expected a number from 0 to 1, or the name of an attribute"
            )

    def _check_rest(self, attribute: str) -> None:
        types = {field.name: field.type for field in self.fields.all}
        known = types.get(attribute)
        if known is None:
            near = nearest(attribute, list(types))
            raise MisuseError(f"{self.name}: rest: no attribute {attribute}{near}")
        if known.kind in ("cells", "matrix") or known.words:
            raise MisuseError(
                f"{self.name}.{attribute} is of the type {known}, which has no value at rest;"
                " expected a number, bool, text, list or string"
            )

    def chance(self, event_type: str) -> float | str:
        """The probability with which it responds to an event of a type; by default 1."""
        for answered, h in self.chances:
            if answered == event_type:
                return h
        return 1.0

    def sort_of(self, attribute: str) -> str:
        """The sort of an attribute in conditions; empty if it cannot be compared."""
        kinds = [declared.type.kind for declared in self.fields.all if declared.name == attribute]
        return sort_of_kind(kinds[0]) if kinds else ""


class EventType:
    """An event type d ∈ D with typed data; calling it returns an event.

    Args:
        name: begins with e.
        visual: d ∈ V: agents respond with views instead of an evolution.
        completes: event types of orders; an agent that sends this event has carried one out.
        fails: event types of orders; an agent that sends this event has given one up.
        replaces: event types of orders, this one or others, that agents drop for such an order.
        data: names with types, such as `heat=float`, or with `Default(type, value)`.

    Raises:
        MisuseError: an invalid name or type.

    Example:
        >>> eSun = EventType("eSun", heat=Default(float, 0.4))
        >>> eSun(heat=0.6, receivers=["anna"]).heat
        0.6

    """

    def __init__(
        self,
        name: str,
        /,
        visual: bool = False,
        completes: ReportedTypes = (),
        fails: ReportedTypes = (),
        replaces: ReportedTypes = (),
        **data: Any,
    ) -> None:
        self.name = _checked(name, "an event type", "e")
        self.visual = visual
        self.completes = _names_of(completes)
        self.fails = _names_of(fails)
        self.replaces = _names_of(replaces)
        self.fields = Fields.of(data)
        for datum in self.fields.names:
            # An event's own attribute would hide the datum.
            if hasattr(Event, datum):
                raise MisuseError(
                    f"{name} cannot have data named {datum}: this is an attribute of all events"
                )

    def __repr__(self) -> str:
        return f"<event type {self.name}>"

    def __call__(
        self,
        /,
        *args: Any,
        receivers: Iterable[str] = (),
        sender: str = "",
        condition: str = "",
        **kwargs: Any,
    ) -> Any:
        """An event; or `Events` with a row for each, if data are arrays or receivers are `Ids`.

        Raises MisuseError, and VocabularyError for an invalid condition.
        """
        if isinstance(receivers, Ids) or any(map(is_array, (*args, *kwargs.values()))):
            return self._many(args, kwargs, receivers, condition)
        values = self.fields.bind(self.name, args, kwargs)
        if condition:
            # Parsed for its errors only, so that they appear where the event is created.
            parse_condition(text("condition", condition))
        to = receiver_ids(receivers) if receivers else ()
        return Event(self.name, self.fields.names, values, condition, sender, to)

    def _many(
        self,
        args: tuple[Any, ...],
        kwargs: Mapping[str, Any],
        receivers: Iterable[str],
        condition: str,
    ) -> Events:
        given = self.fields.merged(self.name, args, kwargs)
        to = receivers if isinstance(receivers, Ids) else None
        # Ids or an array give the number of events; other arrays must have the same length.
        count = len(next(filter(is_array, given.values())) if to is None else to)
        columns = self.fields.columns(self.name, given, count)
        if condition:
            parse_condition(text("condition", condition))
        listed = () if to is not None else receiver_ids(receivers)
        if len(listed) > 1:
            raise MisuseError(f"a batch of {self.name} needs one receiver for each event, as Ids")
        if listed:
            to = Ids.of(listed).take(np.zeros(count, np.intp))
        return Events(self.name, self.fields.names, columns, count, condition, None, to)


ReportedTypes: TypeAlias = "EventType | str | Sequence[EventType | str]"
"""Event types of orders, or their names."""


def _names_of(orders: ReportedTypes) -> tuple[str, ...]:
    several = (orders,) if isinstance(orders, EventType | str) else orders
    return tuple([each if isinstance(each, str) else each.name for each in several])


def receiver_ids(receivers: object) -> tuple[str, ...]:
    """The receivers of an event, each once, sorted. Raises MisuseError for anything but ids."""
    is_list = isinstance(receivers, Iterable) and not isinstance(receivers, str)
    given: list[object] = list(cast("Iterable[object]", receivers)) if is_list else [receivers]
    ids = [value for value in given if isinstance(value, str)]
    if not is_list or len(ids) != len(given):
        raise MisuseError(f"receivers must be a list of ids, receivers=[...], not {receivers!r}")
    odd = invalid_id(ids)
    if odd is not None:
        raise MisuseError(f"receivers: {no_id(odd)}")
    return tuple(sorted(set(ids)))


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
            add = "add its class or symbol to Vocabulary.of(...)"
            raise Unfit(f"the vocabulary has no {symbol}{nearest(symbol, known, add)}")
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
