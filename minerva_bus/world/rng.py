"""Random streams: one for each (seed, who, frame), whatever runs where.

Two kinds. `stream` is a numpy Generator with all its distributions, for who draws much. `Rng`
draws for one agent and `RngBatch` a number for each of many at once, the same numbers either way:
SplitMix64 (Steele, Lea and Flood 2014), begun for each agent at a hash of the three.

Normal and exponential draws use `minerva_bus.portable`: numpy's logarithm depends on the processor.
Of a numpy Generator's draws, those of `random`, `uniform` and `integers` do not; `portable.normal`
makes normal numbers of them.
"""

from __future__ import annotations

from functools import lru_cache
from hashlib import blake2b
from math import floor
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.portable import log
from minerva_bus.portable.normal import standard_normal

Words = NDArray[np.uint64]
Numbers = NDArray[np.float64]

_GAMMA: Final = 0x9E3779B97F4A7C15
_FIRST: Final = 0xBF58476D1CE4E5B9
_SECOND: Final = 0x94D049BB133111EB
_UNIT: Final = 2.0**-53
_MASK: Final = (1 << 64) - 1


def stream(seed: int, who: str, frame: int) -> np.random.Generator:
    """The stream of an agent (`#id`) or a generator (its name) in a frame.

    A Philox counter generator keyed by BLAKE2b of the three: no draw depends on another's.
    """
    key = blake2b(f"{seed}\0{who}\0{frame}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(key, "little")))


def hash_of(agent: str) -> int:
    """A polynomial hash of an id's bytes, modulo 2^64; that of `Ids.hashes`."""
    found = 0
    for letter in agent.encode():
        found = (found * _GAMMA + letter) & _MASK
    return found


@lru_cache(maxsize=4)
def frame_key(seed: int, frame: int) -> int:
    """What a frame adds to the streams of all its agents."""
    return int.from_bytes(blake2b(f"{seed}\0{frame}".encode(), digest_size=8).digest(), "little")


@lru_cache(maxsize=64)
def answer_key(seed: int, frame: int, event_type: str) -> int:
    """What a frame adds to the streams that decide which events of a type agents answer.

    They are other streams than those that λ draws from, which therefore keep their numbers.
    """
    told = f"{seed}\0{frame}\0{event_type}"
    return int.from_bytes(blake2b(told.encode(), digest_size=8).digest(), "little")


_B = TypeVar("_B", bool, NDArray[np.bool_])
_I = TypeVar("_I", int, NDArray[np.int64])
_R = TypeVar("_R", float, Numbers)


class _Draws(Generic[_B, _I, _R]):
    """What can be drawn; bounds, means and so on may be arrays where the draws are."""

    __slots__ = ()

    def random(self) -> _R:
        """Uniform in [0, 1)."""
        raise NotImplementedError

    def _whole(self, least: Any, number: _R) -> _I:
        raise NotImplementedError

    def _kept(self, number: Any) -> _R:
        raise NotImplementedError

    def uniform(self, low: Any = 0.0, high: Any = 1.0) -> _R:
        """Uniform in [low, high)."""
        return low + (high - low) * self.random()

    def integers(self, low: Any, high: Any = None) -> _I:
        """A whole number in [low, high), or in [0, low) where one is given; bounds below 2^53.

        Raises MisuseError where there is none.
        """
        least, below = (0, low) if high is None else (low, high)
        none = below <= least
        if none is True or (none is not False and np.any(none)):
            raise MisuseError(f"there is no whole number from {least} below {below}")
        return self._whole(least, (below - least) * self.random())

    def chance(self, probability: Any) -> _B:
        """True with this probability."""
        return self.random() < probability

    def exponential(self, mean: Any = 1.0) -> _R:
        """Exponentially distributed, with this mean."""
        return self._kept(-mean * log(1.0 - self.random()))

    def normal(self, mean: Any = 0.0, deviation: Any = 1.0) -> _R:
        """Normally distributed, by the method of Box and Muller (1958); two draws."""
        return self._kept(mean + deviation * standard_normal(self.random(), self.random()))


class Rng(_Draws[bool, int, float]):
    """The draws of one agent in a frame."""

    __slots__ = ("word",)

    def __init__(self, word: int) -> None:
        self.word = word

    @staticmethod
    def of(agent: int, key: int) -> Rng:
        """From the hash of the agent's id and the key of the frame."""
        return Rng(_mixed_one(agent ^ key))

    def as_many(self) -> RngBatch:
        """The same draws for a population of this one agent; `take` what is left of them."""
        return RngBatch(np.array([self.word], np.uint64))

    def take(self, drawn: RngBatch) -> None:
        """Go on where a population of this one agent has come to."""
        self.word = int(drawn.words[0])

    def random(self) -> float:
        self.word = (self.word + _GAMMA) & _MASK
        return (_mixed_one(self.word) >> 11) * _UNIT

    def _whole(self, least: int, number: float) -> int:
        return least + floor(number)

    def _kept(self, number: Any) -> float:
        return float(number)


class RngBatch(_Draws[NDArray[np.bool_], NDArray[np.int64], Numbers]):
    """The draws of some of many agents in a frame: one number each, shape (n,)."""

    __slots__ = ("_rows", "words")

    def __init__(self, words: Words, rows: NDArray[np.intp] | None = None) -> None:
        self.words = words
        self._rows = rows

    @staticmethod
    def begin(agents: Words, key: int) -> Words:
        """Where the streams of some agents begin in a frame, from their ids' hashes."""
        return _mixed(agents ^ np.uint64(key))

    def of(self, rows: NDArray[np.intp] | None) -> RngBatch:
        """The draws of some rows of these; the others' streams stay where they are."""
        if rows is None or self._rows is None:
            return RngBatch(self.words, self._rows if rows is None else rows)
        return RngBatch(self.words, self._rows[rows])

    def random(self) -> Numbers:
        if self._rows is None:
            self.words += np.uint64(_GAMMA)
            words = self.words
        else:
            words = self.words[self._rows] + np.uint64(_GAMMA)
            self.words[self._rows] = words
        return (_mixed(words) >> np.uint64(11)).astype(np.float64) * _UNIT

    def _whole(self, least: Any, number: Numbers) -> NDArray[np.int64]:
        return least + number.astype(np.int64)

    def _kept(self, number: Numbers) -> Numbers:
        return number


def _mixed(words: Words) -> Words:
    mixed = words >> np.uint64(30)
    mixed ^= words
    mixed *= np.uint64(_FIRST)
    mixed ^= mixed >> np.uint64(27)
    mixed *= np.uint64(_SECOND)
    mixed ^= mixed >> np.uint64(31)
    return mixed


def _mixed_one(word: int) -> int:
    word = ((word ^ (word >> 30)) * _FIRST) & _MASK
    word = ((word ^ (word >> 27)) * _SECOND) & _MASK
    return word ^ (word >> 31)
