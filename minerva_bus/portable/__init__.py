"""Elementary functions with the same bits on every processor, for numbers and for numpy arrays.

Those of Python, numpy and the C library choose their code by what the processor can do, and so
their last bits differ between machines. These are made of + - * /, of the square root and of exact
steps (rounding to whole numbers, powers of 2), which IEEE 754 prescribes to the last bit, in one
order for numbers and for arrays. Use them for whatever gets into the string:

    from minerva_bus import portable

    self.x += portable.cos(math.radians(self.angle))

Numbers in, a number out; for what is not defined they raise as `math` does (ValueError,
OverflowError). Arrays of any shape in, a float64 array out; there it is nan or infinite. Angles are
in radians; `math.radians` and `math.degrees` are one multiplication, and so the same everywhere.
"""

from minerva_bus.portable.arcs import acos, asin, atan, atan2
from minerva_bus.portable.circle import cos, sin, tan
from minerva_bus.portable.exponentials import exp, expm1, tanh
from minerva_bus.portable.lengths import dist, hypot
from minerva_bus.portable.logarithms import log, log1p, log2, log10
from minerva_bus.portable.normal import normal, normals
from minerva_bus.portable.powers import power

__all__ = [
    "acos",
    "asin",
    "atan",
    "atan2",
    "cos",
    "dist",
    "exp",
    "expm1",
    "hypot",
    "log",
    "log1p",
    "log2",
    "log10",
    "normal",
    "normals",
    "power",
    "sin",
    "tan",
    "tanh",
]
