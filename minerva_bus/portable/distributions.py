"""Distributions: numbers from uniform ones in [0, 1), and draws from streams of SplitMix64.

The first functions accept numbers and arrays. Those named `draw_...` take the next numbers of one
stream, `words[i]`; machine code and rules of spaces use them.
"""

from __future__ import annotations

from typing import Any

from minerva_bus.portable.logarithms import log
from minerva_bus.portable.normal import standard_normal
from minerva_bus.portable.splitmix import GAMMA, MASK, Words, unit_one

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
