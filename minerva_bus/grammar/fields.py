"""Declarations of parameters, attributes and data: names, types, defaults.

One declaration, `Fields`, is shared by all occurrences of a symbol; it types their values.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from operator import is_
from typing import Any, Final

import numpy as np

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.columns import Column, Columns, fit_array, is_array, repeated
from minerva_bus.grammar.scene import Value
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.grammar.types import INT_END, Type, Unfit, converted, type_of

NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""Valid names of parameters and symbols."""


@dataclass(frozen=True, slots=True)
class Default:
    """A parameter's annotation and its default value, for symbols and event types.

    Attributes:
        annotation: a type, such as `float` or `Metres`.
        value: the value if none is given, in the unit of the type.

    Example:
        `eSun = EventType("eSun", heat=Default(float, 0.4))`

    """

    annotation: Any
    value: Any


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A named, typed parameter, attribute or datum; without a default its value is required."""

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
        return same_values((self.default,), (other.default,))  # == of matrices is elementwise.

    def __hash__(self) -> int:
        # Without the default, which may be a matrix and then has no hash.
        return hash((self.name, self.type))

    @staticmethod
    def of(name: str, annotation: Any) -> Field:
        """A field from an annotation, or a `Default`. Raises MisuseError."""
        if not NAME.fullmatch(name):
            raise MisuseError(
                f"a parameter's name has letters (A to Z), digits and _, not {name!r}"
            )
        with_default = isinstance(annotation, Default)
        try:
            kind = type_of(annotation.annotation if with_default else annotation)
        except MisuseError as error:
            raise MisuseError(f"{name}: {error}") from None
        if not with_default:
            return Field(name, kind)
        try:
            return Field(name, kind, kind.fit(annotation.value))
        except Unfit as unfit:
            raise MisuseError(f"the default of {name} must be {unfit}") from None


class _NoFormer:
    """Stands for a missing value; no attribute has it as its value.

    A class, because digests of code describe classes by their names, but no object without data.
    """


@dataclass(frozen=True, slots=True)
class Fields:
    """An ordered set of fields, shared by all occurrences of a symbol."""

    all: tuple[Field, ...] = ()
    names: tuple[str, ...] = field(init=False)
    holding_strings: tuple[int, ...] = field(init=False, repr=False, compare=False)
    """Places of the fields whose values are, or contain, strings."""
    _plain: tuple[type | None, ...] = field(init=False, repr=False, compare=False)
    _no_former: tuple[type, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple([parameter.name for parameter in self.all]))
        holding = [place for place, of in enumerate(self.all) if of.type.holds_strings]
        object.__setattr__(self, "holding_strings", tuple(holding))
        # Types whose finite floats or ASCII texts need no conversion, once for all occurrences.
        plain = [_plain_type(parameter.type) for parameter in self.all]
        object.__setattr__(self, "_plain", tuple(plain))
        object.__setattr__(self, "_no_former", (_NoFormer,) * len(plain))

    @staticmethod
    def of(annotations: Mapping[str, Any]) -> Fields:
        """Fields from annotations by name."""
        return Fields(tuple(Field.of(name, wanted) for name, wanted in annotations.items()))

    def values(self, owner: str, given: Mapping[str, Any]) -> tuple[Value, ...]:
        """The given values in the declared order, typed, defaults filled in. Raises Unfit."""
        if len(given) > len(self.all) or not set(self.names).issuperset(given):
            raise Unfit(self._unknown(owner, given))
        values: list[Any] = []
        for parameter in self.all:
            value = given.get(parameter.name, parameter.default)
            if value is None:
                raise Unfit(f"{owner} needs a value for {parameter.name} ({parameter.type})")
            values.append(value)
        return tuple(values if self.is_final(values) else self.fitted(owner, values))

    def fit(self, owner: str, field: Field, value: Any) -> Value:
        """One value, typed. Raises Unfit with the owner's and the field's name."""
        try:
            return field.type.fit(value)
        except Unfit as unfit:
            wrong = Unfit(f"{owner}: {field.name} must be {unfit}")
            wrong.attribute = field.name
            raise wrong from None

    def fitted(
        self, owner: str, values: Sequence[Any], former: Sequence[Value] = ()
    ) -> list[Value]:
        """Values in the declared order, typed; any `former` ones already are. Raises Unfit."""
        return [
            value  # The most frequent cases, without calls of ours.
            if value is was
            or (plain is float and type(value) is float and isfinite(value))
            or (plain is str and type(value) is str and value.isascii())
            or (plain is int and type(value) is int and -INT_END <= value < INT_END)
            or (plain is bool and type(value) is bool)
            else self.fit(owner, parameter, value)
            for parameter, plain, value, was in zip(
                self.all, self._plain, values, former or self._no_former, strict=True
            )
        ]

    def is_final(self, values: Sequence[Any]) -> bool:
        """Whether these values, one for each field, need no conversion or check."""
        if tuple(map(type, values)) != self._plain:
            return False
        for value in values:
            kind = value.__class__
            if kind is float:
                final = isfinite(value)
            elif kind is str:
                final = value.isascii()
            else:
                final = kind is bool or -INT_END <= value < INT_END
            if not final:
                return False
        return True

    def are_final(self, columns: Iterable[tuple[Any, ...]]) -> bool:
        """Whether the values in these columns, one for each field, need no conversion or check."""
        return all(
            plain is not None and converted(of.type.kind, column) is column
            for plain, of, column in zip(self._plain, self.all, columns, strict=True)
        )

    def refit(
        self, owner: str, names: tuple[str, ...], values: tuple[Value, ...]
    ) -> tuple[tuple[str, ...], tuple[Value, ...]]:
        """(names, values) of an occurrence in canonical form; the same objects if they already are.

        Raises Unfit.
        """
        is_declared = names is self.names  # The usual case: each name once, in order.
        if len(names) != len(values) or (not is_declared and len(set(names)) != len(names)):
            raise Unfit(f"{owner} needs one value for each name, and each name once")
        # Another order of names, or missing ones with defaults.
        if not is_declared and names != self.names:
            return self.names, self.values(owner, dict(zip(names, values, strict=True)))
        if self.is_final(values):
            return self.names, values
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

    def bind_columns(self, owner: str, args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> Columns:
        """Nodes of a symbol from a call's arguments, some of them arrays. Raises MisuseError."""
        given = self.merged(owner, args, kwargs) if args else kwargs
        count = next((len(value) for value in given.values() if is_array(value)), 0)
        return Columns(owner, self.names, self.columns(owner, given, count), count)

    def columns(self, owner: str, given: Mapping[str, Any], count: int) -> tuple[Column, ...]:
        """Columns of a length from arrays, and from single values for all. Raises MisuseError."""
        try:
            if any(name not in self.names for name in given):
                raise Unfit(self._unknown(owner, given))
            return tuple([self._column(owner, parameter, given, count) for parameter in self.all])
        except Unfit as unfit:
            raise MisuseError(str(unfit)) from None

    def _column(self, owner: str, field: Field, given: Mapping[str, Any], count: int) -> Column:
        value = given.get(field.name, field.default)
        if value is None:
            raise Unfit(f"{owner} needs a value for {field.name} ({field.type})")
        if len(getattr(value, "shape", ())) == 1 and not is_array(value):
            value = np.array(value)  # A series of pandas or polars, which may change later.
        try:
            if not is_array(value):
                return repeated(field.type, value, count)
            if len(value) != count:
                raise Unfit(f"{count} values, not {len(value)}")
            return fit_array(field.type, value)
        except Unfit as unfit:
            listed = isinstance(value, (list, tuple))
            hint = f"; for {count} different values use an array" if listed else ""
            raise Unfit(f"{owner}: {field.name} must be {unfit}{hint}") from None

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


def _plain_type(wanted: Type) -> type | None:
    """The type of which finite floats, ASCII texts, bools and ints of 64 bits are values as is."""
    if wanted.range is not None or wanted.words:
        return None
    return _PLAIN.get(wanted.kind)


_PLAIN: Final = {"real": float, "text": str, "int": int, "bool": bool}
