"""Limits of a type, and units of measure in texts with their conversion.

A parameter is declared and stored in one unit; a text may use another unit of the same dimension
(`dist=150cm` for a parameter in metres).

| text             | in Python                                    | value                         |
|------------------|----------------------------------------------|-------------------------------|
| `real m/s 0..`   | `Annotated[MetresPerSecond, Range(least=0)]` | a number from 0 up            |
| `int 1..6`       | `Annotated[int, Range(1, 6)]`                | a number from 1 to 6          |
| `text of P.name` | `Annotated[str, Of("P", "name")]`            | a `name` of a P in the string |

Both limits are for data of event types. A range is checked wherever an event is created. Only the
coordinator knows the string, so it checks sources, for orders of people.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from numbers import Real
from typing import Final

from minerva_bus.errors import MisuseError

# unit → (dimension, a, b): one unit is a/b of the dimension's first unit. Two integers, so that
# 57cm is the float64 nearest to 57/100 m, which 57·0.01 is not.
_UNITS: dict[str, tuple[str, float, float]] = {
    "m": ("length", 1, 1),
    "km": ("length", 1000, 1),
    "cm": ("length", 1, 100),
    "mm": ("length", 1, 1000),
    "deg": ("angle", 1, 1),
    "°": ("angle", 1, 1),
    "rad": ("angle", 180, math.pi),
    "s": ("time", 1, 1),
    "ms": ("time", 1, 1000),
    "min": ("time", 60, 1),
    "h": ("time", 3600, 1),
    "m/s": ("speed", 1, 1),
    "km/h": ("speed", 10, 36),
    "cm/s": ("speed", 1, 100),
    "deg/s": ("turning", 1, 1),
    "rad/s": ("turning", 180, math.pi),
    "Hz": ("frequency", 1, 1),
    "kg": ("mass", 1, 1),
    "g": ("mass", 1, 1000),
}


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of measure by its symbol, for `Annotated[float, Unit("m")]`."""

    symbol: str

    def __post_init__(self) -> None:
        if self.symbol not in _UNITS:
            raise MisuseError(f"unknown unit {self.symbol!r}; expected one of {', '.join(_UNITS)}")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with a unit as in the text, not converted yet."""

    number: float
    unit: str

    def into(self, unit: str) -> float | None:
        """The number in another unit, or None if the dimensions differ."""
        own, wanted = _UNITS.get(self.unit), _UNITS.get(unit)
        if own is None or wanted is None or own[0] != wanted[0]:
            return None
        if self.unit == unit:
            return self.number
        return self.number * (own[1] * wanted[2]) / (own[2] * wanted[1])


_BETWEEN: Final = ".."
_SYMBOL: Final = re.compile(r"[PTA][A-Za-z0-9_]*")
_PARAMETER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers from `least` to `most`, both included, in the unit of the type.

    Raises:
        MisuseError: there is no such number, or no limit at all.

    Example:
        `eSpeed = EventType("eSpeed", speed=Annotated[MetresPerSecond, Range(least=0)])`

    """

    least: float = -math.inf
    most: float = math.inf

    def __post_init__(self) -> None:
        for end in (self.least, self.most):
            if isinstance(end, bool) or not isinstance(end, Real):  # pyright: ignore[reportUnnecessaryIsInstance]
                raise MisuseError(f"an end of a range must be a number, not {end!r:.60}")
        if not self.least <= self.most or (math.isinf(self.least) and math.isinf(self.most)):
            raise MisuseError(
                f"invalid range {self}; expected a minimum, a maximum, or both in this order"
            )

    def __str__(self) -> str:
        least, most = (_shown(end) for end in (self.least, self.most))
        return f"{least}{_BETWEEN}{most}"

    @property
    def words(self) -> str:
        """The range in words, for messages."""
        if math.isinf(self.most):
            return f"from {_shown(self.least)} up"
        if math.isinf(self.least):
            return f"up to {_shown(self.most)}"
        return f"from {_shown(self.least)} to {_shown(self.most)}"

    def holds(self, number: float) -> bool:
        """Whether a number lies in it."""
        return self.least <= number <= self.most


def parse_range(text: str) -> Range | None:
    """The range in a text such as `0..`; None for a text without `..`. Raises MisuseError."""
    least, between, most = text.partition(_BETWEEN)
    if not between:
        return None
    try:
        return Range(float(least or "-inf"), float(most or "inf"))
    except ValueError:
        raise MisuseError(f"invalid range {text!r}; expected 0.., ..6 or 0..6") from None


def _shown(end: float) -> str:
    return "" if math.isinf(end) else repr(float(end)).removesuffix(".0")


@dataclass(frozen=True, slots=True)
class Of:
    """The values that a parameter of a symbol has in the world's string: a limit of texts.

    Attributes:
        symbol: name of a primitive, transformation or agent kind.
        parameter: name of its parameter or attribute.

    Raises:
        MisuseError: one of them is not a name.

    Example:
        `eObjective = EventType("eObjective", marker=Annotated[str, Of("PMarker", "name")])`

    """

    symbol: str
    parameter: str

    def __post_init__(self) -> None:
        if not (_SYMBOL.fullmatch(self.symbol) and _PARAMETER.fullmatch(self.parameter)):
            raise MisuseError(
                f"invalid source of texts {self}; expected SYMBOL.parameter, such as PMarker.name"
            )

    def __str__(self) -> str:
        return f"{self.symbol}.{self.parameter}"


def parse_of(text: str) -> Of:
    """The source of texts that `SYMBOL.parameter` names. Raises MisuseError."""
    symbol, _, parameter = text.partition(".")
    return Of(symbol, parameter)
