"""Distributions: numbers from uniform ones in [0, 1), and draws from streams of SplitMix64.

SplitMix64 (Steele, Lea and Flood 2014) makes words and the numbers that they become; normally
distributed numbers come from uniform ones by G. Box and M. Muller (1958). The first functions
accept numbers and arrays. Those named `draw_...` take the next numbers of one stream, `words[i]`;
machine code and rules of spaces use them. The streams of agents and generators, by (seed, id,
frame), are in world/context.py.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.portable.logarithms import log, log_many, log_one
from minerva_bus.portable.polynomials import Numbers, binary
from minerva_bus.portable.trigonometry import cos_turns_many, cos_turns_one

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


def standard_normal_one(first: float, second: float) -> float:
    """A standard normal number from two uniform ones in [0, 1)."""
    # 1 - u is in (0, 1], so the logarithm is finite.
    return math.sqrt(-2.0 * log_one(1.0 - first)) * cos_turns_one(second)


def standard_normal_many(first: Numbers, second: Numbers) -> Numbers:
    """`standard_normal` of each pair."""
    return np.sqrt(-2.0 * log_many(1.0 - first)) * cos_turns_many(second)


standard_normal = binary(standard_normal_one, standard_normal_many)


def normal(random: np.random.Generator, deviation: float = 1.0) -> float:
    """A normal number with mean 0, from two uniform draws.

    The `normal` of a Generator uses the logarithm of the C library.
    """
    first, second = random.random(2).tolist()
    return deviation * standard_normal_one(first, second)


def normals(random: np.random.Generator, count: int, deviation: float = 1.0) -> Numbers:
    """Normal numbers with mean 0, (count,), from two uniform draws each.

    They differ from those of repeated calls of `normal`, because the first numbers of all pairs are
    drawn before the second ones.
    """
    first, second = random.random((2, count))
    return deviation * standard_normal_many(first, second)


_log: Any = log
_standard_normal: Any = standard_normal


def between(unit: Any, low: Any, high: Any) -> Any:
    """A number in [low, high)."""
    return low + (high - low) * unit


def whole_between(unit: float, low: int, high: int) -> int:
    """An int in [low, high), for bounds below 2^53."""
    return low + int((high - low) * unit)


def exponential(unit: Any, minus_mean: Any) -> Any:
    """An exponentially distributed number from the negative of its mean."""
    # 1 - u is in (0, 1], so the logarithm is finite.
    return minus_mean * _log(1.0 - unit)


def normally(first: Any, second: Any, mean: Any, deviation: Any) -> Any:
    """A normally distributed number from two uniform ones."""
    return mean + deviation * _standard_normal(first, second)


def draw_random(words: Words, i: int) -> float:
    """Uniform in [0, 1)."""
    word = (int(words[i]) + GAMMA) & MASK
    words[i] = word
    return unit_one(word)


def draw_uniform(words: Words, i: int, low: float, high: float) -> float:
    """Uniform in [low, high)."""
    return between(draw_random(words, i), low, high)


def draw_integers(words: Words, i: int, low: int, high: int) -> int:
    """An int in [low, high), which must not be empty."""
    return whole_between(draw_random(words, i), low, high)


def draw_chance(words: Words, i: int, probability: float) -> bool:
    """True with this probability."""
    return draw_random(words, i) < probability


def draw_exponential(words: Words, i: int, minus_mean: float) -> float:
    """Exponentially distributed."""
    return exponential(draw_random(words, i), minus_mean)


def draw_normal(words: Words, i: int, mean: float, deviation: float) -> float:
    """Normally distributed, by the method of Box and Muller (1958); takes two draws."""
    first = draw_random(words, i)
    second = draw_random(words, i)
    return normally(first, second, mean, deviation)
