"""SplitMix64 (Steele, Lea and Flood 2014): words, and the numbers that they become.

The forms for one word are also compiled from this source: numba types the constants as 64-bit
words, whose products drop the upper bits by themselves.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]

GAMMA: Final = 0x9E3779B97F4A7C15
"""Step of a stream; odd, so a stream has a period of 2^64."""
FIRST: Final = 0xBF58476D1CE4E5B9
SECOND: Final = 0x94D049BB133111EB
MASK: Final = (1 << 64) - 1
UNIT: Final = 2.0**-53


def mixed_one(word: int) -> int:
    """A word whose bits depend on all bits of another one."""
    word = ((word ^ (word >> 30)) * FIRST) & MASK
    word = ((word ^ (word >> 27)) * SECOND) & MASK
    return word ^ (word >> 31)


def mixed_many(words: Words) -> Words:
    """`mixed_one` of each word."""
    # One new array; all other steps are in place, because a frame may have a million words.
    mixed = words >> np.uint64(30)
    mixed ^= words
    mixed *= np.uint64(FIRST)
    mixed ^= mixed >> np.uint64(27)
    mixed *= np.uint64(SECOND)
    mixed ^= mixed >> np.uint64(31)
    return mixed


def unit_one(word: int) -> float:
    """The number in [0, 1) of a word of a stream."""
    # The upper 53 bits of the word are what a float64 in [0, 1) holds exactly.
    return (mixed_one(word) >> 11) * UNIT


def unit_many(words: Words) -> NDArray[np.float64]:
    """`unit_one` of each word."""
    return (mixed_many(words) >> np.uint64(11)).astype(np.float64) * UNIT
