"""The alphabets: primitives P, transformations T, agent kinds A^D_ST and event types D."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from operator import is_
from typing import Any

import numpy as np

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.arrays import fit_array, is_array, repeated
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.columns import Column, Columns, around_each
from minerva_bus.grammar.condition import parse_condition
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.forms import Form, Motion, Shape, parameters_of
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import FigureNode, Scene, TransformationNode, Value
from minerva_bus.grammar.types import Type, Unfit, type_of

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Default:
    """A parameter's annotation with the value it has where none is given."""

    annotation: Any
    value: Any


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A named, typed parameter, attribute or datum; without a default it must be given."""

    name: str
    type: Type
    default: Value | None = None

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Field):
            return NotImplemented
        if (self.name, self.type) != (other.name, other.type):
            return False
        if self.default is None or other.default is None:
            return self.default is other.default
        return same_values((self.default,), (other.default,))  # which matrices have no == for

    def __hash__(self) -> int:
        return hash((self.name, self.type))

    @staticmethod
    def of(name: str, annotation: Any) -> Field:
        """A field from an annotation, or a `Default`. Raises MisuseError."""
        if not _NAME.fullmatch(name):
            raise MisuseError(f"{name!r} is no name of a parameter")
        if not isinstance(annotation, Default):
            return Field(name, type_of(annotation))
        kind = type_of(annotation.annotation)
        try:
            return Field(name, kind, kind.fit(annotation.value))
        except Unfit as unfit:
            raise MisuseError(f"the default of {name} must be {unfit}") from None


@dataclass(frozen=True, slots=True)
class Fields:
    """An ordered set of fields, shared by all occurrences of a symbol."""

    all: tuple[Field, ...] = ()
    names: tuple[str, ...] = field(init=False)
    hold_strings: bool = field(init=False, repr=False, compare=False)
    _reals: tuple[bool, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple([one.name for one in self.all]))
        holds = any(one.type.holds_strings for one in self.all)
        object.__setattr__(self, "hold_strings", holds)
        object.__setattr__(self, "_reals", tuple([one.type.kind == "real" for one in self.all]))

    @staticmethod
    def of(annotations: Mapping[str, Any]) -> Fields:
        """Fields from annotations by name."""
        return Fields(tuple(Field.of(name, wanted) for name, wanted in annotations.items()))

    def values(self, owner: str, given: Mapping[str, Any]) -> tuple[Value, ...]:
        """The given values in the declared order, typed, defaults filled in. Raises Unfit."""
        if len(given) > len(self.all) or any(name not in self.names for name in given):
            raise Unfit(self._unknown(owner, given))
        values = [given.get(one.name, one.default) for one in self.all]
        for one, value in zip(self.all, values, strict=True):
            if value is None:
                raise Unfit(f"{owner} needs a value for {one.name} ({one.type})")
        return tuple(self.fitted(owner, values))

    def fit(self, owner: str, one: Field, value: Any) -> Value:
        """One value, typed. Raises Unfit with the owner's and the field's name."""
        try:
            return one.type.fit(value)
        except Unfit as unfit:
            raise Unfit(f"{owner}: {one.name} must be {unfit}") from None

    def fitted(self, owner: str, values: Sequence[Any]) -> list[Value]:
        """Values in the declared order, typed. Raises Unfit."""
        return [
            value  # most values of most symbols, so they are spared the calls
            if real and type(value) is float and isfinite(value)
            else self.fit(owner, one, value)
            for one, real, value in zip(self.all, self._reals, values, strict=True)
        ]

    def refit(
        self, owner: str, names: tuple[str, ...], values: tuple[Value, ...]
    ) -> tuple[tuple[str, ...], tuple[Value, ...]]:
        """(names, values) of an occurrence in canonical form; the very ones if they are.

        Raises Unfit.
        """
        if len(names) != len(values) or len(set(names)) != len(names):
            raise Unfit(f"{owner} needs one value for each name, and each name once")
        if names is not self.names and names != self.names:
            return self.names, self.values(owner, dict(zip(names, values, strict=True)))
        fitted = self.fitted(owner, values)
        return self.names, (values if all(map(is_, fitted, values)) else tuple(fitted))

    def bind(
        self, owner: str, args: tuple[Any, ...], kwargs: Mapping[str, Any]
    ) -> tuple[Value, ...]:
        """Values from a call's arguments, as Python would bind them. Raises MisuseError."""
        given = self.merged(owner, args, kwargs) if args else kwargs
        try:
            return self.values(owner, given)
        except Unfit as unfit:
            raise MisuseError(str(unfit)) from None

    def bind_columns(
        self, owner: str, args: tuple[Any, ...], kwargs: Mapping[str, Any]
    ) -> tuple[tuple[Column, ...], int]:
        """Columns from a call's arguments, some of them arrays; how long. Raises MisuseError."""
        given = self.merged(owner, args, kwargs) if args else kwargs
        count = next((len(value) for value in given.values() if is_array(value)), 0)
        return self.columns(owner, given, count), count

    def columns(self, owner: str, given: Mapping[str, Any], count: int) -> tuple[Column, ...]:
        """Columns of a length from arrays, and from single values for all. Raises MisuseError."""
        try:
            if any(name not in self.names for name in given):
                raise Unfit(self._unknown(owner, given))
            return tuple([self._column(owner, one, given, count) for one in self.all])
        except Unfit as unfit:
            raise MisuseError(str(unfit)) from None

    def _column(self, owner: str, one: Field, given: Mapping[str, Any], count: int) -> Column:
        value = given.get(one.name, one.default)
        if value is None:
            raise Unfit(f"{owner} needs a value for {one.name} ({one.type})")
        try:
            if not is_array(value):
                return repeated(one.type, value, count)
            if len(value) != count:
                raise Unfit(f"{count} values, not {len(value)}")
            return fit_array(one.type, value)
        except Unfit as unfit:
            raise Unfit(f"{owner}: {one.name} must be {unfit}") from None

    def merged(
        self, owner: str, args: tuple[Any, ...], kwargs: Mapping[str, Any]
    ) -> Mapping[str, Any]:
        """A call's arguments by name. Raises MisuseError."""
        if len(args) > len(self.all):
            raise MisuseError(f"{owner} takes {len(self.all)} parameters, not {len(args)}")
        given = dict(zip(self.names, args, strict=False))
        for name in kwargs:
            if name in given:
                raise MisuseError(f"{owner} got {name} twice")
        return given | dict(kwargs)

    def _unknown(self, owner: str, given: Mapping[str, Any]) -> str:
        strange = next(name for name in given if name not in self.names)
        listed = ", ".join(self.names) or "none"
        return f"{owner} has no {strange} (it has {listed}){nearest(strange, list(self.names))}"


def _check_form(owner: str, form: Form | None, fields: Fields) -> None:
    for name in parameters_of(form) if form is not None else ():
        if name not in fields.names:
            raise MisuseError(
                f"the form of {owner} uses {name}, which is none of its parameters"
                f"{nearest(name, list(fields.names))}"
            )


def _checked(name: str, alphabet: str, letter: str) -> str:
    if not _NAME.fullmatch(name) or name[0] != letter:
        raise MisuseError(f"the name of {alphabet} begins with {letter}, as in the paper: {name!r}")
    return name


class Primitive:
    """A primitive p ∈ P; calling it gives the string of one figure.

    With arrays of shape (n,) among the parameters it gives n figures, one for each row.
    """

    def __init__(self, name: str, /, shape: Shape | None = None, **parameters: Any) -> None:
        self.name = _checked(name, "a primitive", "P")
        self.shape = shape
        self.fields = Fields.of(parameters)
        _check_form(name, shape, self.fields)

    def __call__(self, /, *args: Any, **kwargs: Any) -> Scene:
        if any(map(is_array, (*args, *kwargs.values()))):
            columns, count = self.fields.bind_columns(self.name, args, kwargs)
            return Scene((Columns(self.name, self.fields.names, columns, count),))
        values = self.fields.bind(self.name, args, kwargs)
        return Scene((FigureNode(self.name, self.fields.names, values),))


class Transformation:
    """A transformation t ∈ T; `t(parameters)(string, ...)` gives the string t(OBJECTS).

    With arrays of shape (n,) among the parameters it gives n transformations, each round its row
    of the scope where that has n rows, and else round all of it.
    """

    def __init__(self, name: str, /, motion: Motion | None = None, **parameters: Any) -> None:
        self.name = _checked(name, "a transformation", "T")
        self.motion = motion
        self.fields = Fields.of(parameters)
        _check_form(name, motion, self.fields)

    def __call__(self, /, *args: Any, **kwargs: Any) -> OpenTransformation:
        if any(map(is_array, (*args, *kwargs.values()))):
            columns, count = self.fields.bind_columns(self.name, args, kwargs)
            return OpenTransformation(
                self, (), Columns(self.name, self.fields.names, columns, count)
            )
        return OpenTransformation(self, self.fields.bind(self.name, args, kwargs))


@dataclass(frozen=True, slots=True)
class OpenTransformation:
    """A transformation with its parameters that still waits for its scope."""

    transformation: Transformation
    values: tuple[Value, ...]
    many: Columns | None = None

    def __call__(self, *scope: Scene) -> Scene:
        name, fields = self.transformation.name, self.transformation.fields
        for one in scope:
            if not isinstance(one, Scene):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise MisuseError(
                    f"the scope of {name} holds strings, not {one!r}; a primitive gives one when"
                    " it is called, a transformation when it is called twice"
                )
        inside = Scene(tuple([piece for one in scope for piece in one.pieces]))
        if self.many is not None:
            return around_each(self.many, inside)
        return Scene((TransformationNode(name, fields.names, self.values, inside),))


@dataclass(frozen=True, slots=True)
class AgentKind:
    """A kind of agents a^D_ST: its state's attributes and the event types it responds to.

    `subscribes` are the types that its evolution answers, `views` those that its views answer.
    """

    name: str
    fields: Fields
    subscribes: frozenset[str] = frozenset()
    views: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        _checked(self.name, "an agent kind", "A")


class EventType:
    """An event type d ∈ D with typed data; calling it gives an event. `visual`: d ∈ V."""

    def __init__(self, name: str, /, visual: bool = False, **data: Any) -> None:
        self.name = _checked(name, "an event type", "e")
        self.visual = visual
        self.fields = Fields.of(data)
        for one in self.fields.names:
            if hasattr(Event, one):
                raise MisuseError(f"{name} cannot have data named {one}: every event has {one}")

    def __call__(
        self,
        /,
        *args: Any,
        receivers: Iterable[str] = (),
        sender: str = "",
        condition: str = "",
        **kwargs: Any,
    ) -> Any:
        """An event; `Events`, a row for each, where data are arrays or receivers are `Ids`.

        Raises MisuseError, and VocabularyError for a condition that is none.
        """
        if isinstance(receivers, Ids) or any(map(is_array, (*args, *kwargs.values()))):
            return self._many(args, kwargs, receivers, condition)
        values = self.fields.bind(self.name, args, kwargs)
        if condition:
            parse_condition(condition)
        to = _ids(receivers) if receivers else ()
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
        count = len(to) if to is not None else lengths[0]
        columns = self.fields.columns(self.name, given, count)
        if condition:
            parse_condition(condition)
        listed = () if to is not None else _ids(receivers)
        if len(listed) > 1:
            raise MisuseError(f"many {self.name} at once have one receiver each: give Ids")
        if listed:
            to = Ids.of(listed).take(np.zeros(count, np.intp))
        return Events(self.name, self.fields.names, columns, count, condition, None, to)


def _ids(receivers: Iterable[object]) -> tuple[str, ...]:
    given = [receivers] if isinstance(receivers, str) else list(receivers)
    ids = [one for one in given if isinstance(one, str)]
    if isinstance(receivers, str) or len(ids) != len(given):
        raise MisuseError(f"receivers are a list of ids: receivers=[...], not {receivers!r}")
    return tuple(sorted(set(ids)))
