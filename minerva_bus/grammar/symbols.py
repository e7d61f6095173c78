"""The alphabets: primitives P, transformations T, agent kinds A^D_ST and event types D."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np

from minerva_bus.arguments import text
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.appearance import Form, Motion, Shape, parameters_of
from minerva_bus.grammar.columns import Columns, around_each, is_array
from minerva_bus.grammar.condition import NUMBER, parse_condition, sort_of_kind
from minerva_bus.grammar.events import Event, Events
from minerva_bus.grammar.fields import NAME, Fields
from minerva_bus.grammar.ids import Ids, invalid_id, no_id
from minerva_bus.grammar.scene import FigureNode, Scene, TransformationNode, Value


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
            f"the name of {alphabet} must be {letter} followed by letters, digits or _,"
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
        lengths = [len(value) for value in given.values() if is_array(value)]
        # Ids or an array give the number of events; other arrays must have the same length.
        count = len(to) if to is not None else lengths[0]
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
