"""Units of measure in texts, and their conversion.

A parameter is declared and stored in one unit; a text may use another unit of the same dimension
(`dist=150cm` for a parameter in metres).
"""

import math
from dataclasses import dataclass

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
