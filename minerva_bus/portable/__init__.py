"""Elementary functions with the same bits on every processor, for numbers and for numpy arrays.

Python, numpy and the C library select code by the features of the processor, so the last bits of
their results differ between machines. These functions consist of + - * /, the square root and exact
steps (rounding to integers, powers of 2), which IEEE 754 defines to the last bit, in the same order
for numbers and for arrays. Use them for whatever enters the string:

    from minerva_bus import portable

    self.x += portable.cos(math.radians(self.angle))

For numbers they return a number, and raise errors like `math` (ValueError, OverflowError). For
arrays of any shape they return a float64 array, with nan or infinity in place of errors. Angles are
in radians; `math.radians` and `math.degrees` are one multiplication and thus the same everywhere.
"""

from minerva_bus.portable.distributions import normal, normals
from minerva_bus.portable.exponentials import exp, expm1, power, tanh
from minerva_bus.portable.logarithms import log, log1p, log2, log10
from minerva_bus.portable.trigonometry import (
    acos,
    asin,
    atan,
    atan2,
    cos,
    cos_sin,
    dist,
    hypot,
    sin,
    tan,
)

__all__ = [
    "acos", "asin", "atan", "atan2", "cos", "cos_sin", "dist", "exp", "expm1", "hypot", "log",
    "log1p", "log2", "log10", "normal", "normals", "power", "sin", "tan", "tanh",
]  # fmt: skip
