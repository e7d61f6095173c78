"""Random streams, keyed by (seed, id, frame): draws do not depend on where an agent runs.

`Rng` draws for one agent, `RngBatch` a number for each agent of a population. Both have the same
interface and draw the same numbers: SplitMix64 (`portable.splitmix`), seeded for each agent with a
hash of the key. numpy's generators cannot be seeded for a million streams per frame.
`stream` is a numpy Generator with all of numpy's distributions.

Normal and exponential draws use `minerva_bus.portable`, because numpy's logarithm depends on the
processor. Of a numpy Generator, `random`, `uniform` and `integers` do not; `portable.normal`
converts their numbers to normal ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from hashlib import blake2b
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.ids import Ids
from minerva_bus.portable.distributions import (
    GAMMA,
    MASK,
    Words,
    between,
    exponential,
    mixed_many,
    mixed_one,
    normally,
    unit_many,
    unit_one,
    whole_between,
)

Numbers = NDArray[np.float64]
Rows = NDArray[np.intp]

_BEGIN_ALL: Final = 16
"""Once one in this many agents has drawn singly, seeding all streams is cheaper."""


def stream(seed: int, who: str, frame: int) -> np.random.Generator:
    """The numpy Generator of an agent (`#id`) or a generator (its name) in a frame.

    A Philox counter generator keyed by BLAKE2b of the three, so no draw depends on another's.
    """
    key = blake2b(f"{seed}\0{who}\0{frame}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(key, "little")))


def hash_of(agent: str) -> int:
    """Polynomial hash of an id's bytes, modulo 2^64; equal to `Ids.hashes`."""
    value = 0
    for letter in agent.encode():
        value = (value * GAMMA + letter) & MASK
    return value


# Every single agent of a frame asks for the same key.
@lru_cache(maxsize=4)
def frame_key(seed: int, frame: int) -> int:
    """Key of a frame's streams; an agent's stream begins at its hash xor this key."""
    return int.from_bytes(blake2b(f"{seed}\0{frame}".encode(), digest_size=8).digest(), "little")


@lru_cache(maxsize=64)
def answer_key(seed: int, frame: int, event_type: str) -> int:
    """Key of the streams that decide which events of a type agents respond to (h of a^{d,h}).

    The streams are separate, so that a probability does not change the numbers that λ draws.
    """
    source = f"{seed}\0{frame}\0{event_type}"
    return int.from_bytes(blake2b(source.encode(), digest_size=8).digest(), "little")


_B = TypeVar("_B", bool, NDArray[np.bool_])
_I = TypeVar("_I", int, NDArray[np.int64])
_R = TypeVar("_R", float, Numbers)


class _Distributions(Generic[_B, _I, _R]):
    """The distributions; for a batch, parameters may be arrays."""

    __slots__ = ()

    def random(self) -> _R:
        """Uniform in [0, 1)."""
        raise NotImplementedError

    def _whole(self, unit: _R, least: Any, below: Any) -> _I:
        raise NotImplementedError

    def _typed(self, number: Any) -> _R:
        raise NotImplementedError

    def uniform(self, low: Any = 0.0, high: Any = 1.0) -> _R:
        """Uniform in [low, high)."""
        return between(self.random(), low, high)

    def integers(self, low: Any, high: Any = None) -> _I:
        """An int in [low, high), or in [0, low) without `high`; bounds below 2^53.

        Raises MisuseError if the range is empty.
        """
        least, below = (0, low) if high is None else (low, high)
        # A plain bool for a single agent, for which `np.any` would take longer than the draw
        # itself.
        none = below <= least
        if none is True or (none is not False and np.any(none)):
            raise MisuseError(f"no integer is in [{least}, {below}); expected low < high")
        return self._whole(self.random(), least, below)

    def chance(self, probability: Any) -> _B:
        """True with this probability."""
        return self.random() < probability

    def exponential(self, mean: Any = 1.0) -> _R:
        """Exponentially distributed, with this mean."""
        return self._typed(exponential(self.random(), -mean))

    def normal(self, mean: Any = 0.0, deviation: Any = 1.0) -> _R:
        """Normally distributed, by the method of Box and Muller (1958); takes two draws."""
        return self._typed(normally(self.random(), self.random(), mean, deviation))


class Rng(_Distributions[bool, int, float]):
    """Draws of one agent in a frame; `word` is the state of its stream."""

    __slots__ = ("word",)

    def __init__(self, word: int) -> None:
        self.word = word

    @staticmethod
    def of(agent: int, key: int) -> Rng:
        """The stream of an agent with this hash under a frame's key."""
        # Mixed: hashes of similar ids may differ by `GAMMA`, the step of a stream, and one stream
        # would then be a shifted copy of the other.
        return Rng(mixed_one(agent ^ key))

    def random(self) -> float:
        self.word = (self.word + GAMMA) & MASK
        return unit_one(self.word)

    def _whole(self, unit: float, least: int, below: int) -> int:
        return whole_between(unit, least, below)

    def _typed(self, number: Any) -> float:
        return float(number)


class RngBatch(_Distributions[NDArray[np.bool_], NDArray[np.int64], Numbers]):
    """Draws of the agents in the given rows: a number for each, shape (n,)."""

    __slots__ = ("_rows", "words")

    def __init__(self, words: Words, rows: Rows | None = None) -> None:
        self.words = words
        self._rows = rows

    @staticmethod
    def begin(agents: Words, key: int) -> Words:
        """Initial states of the streams of agents with these hashes."""
        return mixed_many(agents ^ np.uint64(key))

    def of(self, rows: Rows | None) -> RngBatch:
        """Draws of a selection of these rows; the other streams do not advance."""
        if rows is None or self._rows is None:
            return RngBatch(self.words, self._rows if rows is None else rows)
        return RngBatch(self.words, self._rows[rows])

    def random(self) -> Numbers:
        if self._rows is None:
            self.words += np.uint64(GAMMA)
            words = self.words
        else:
            words = self.words[self._rows] + np.uint64(GAMMA)
            self.words[self._rows] = words
        return unit_many(words)

    def _whole(self, unit: Numbers, least: Any, below: Any) -> NDArray[np.int64]:
        return least + ((below - least) * unit).astype(np.int64)

    def _typed(self, number: Numbers) -> Numbers:
        return number


class Streams:
    """The streams of agents with these ids under one key, for single draws and for batches.

    Each stream continues after its last draw, single or not.
    """

    __slots__ = ("_batch", "_ids", "_key", "_single")

    def __init__(self, ids: Ids | Sequence[str], key: int) -> None:
        self._ids = ids
        self._key = key
        self._batch: RngBatch | None = None
        self._single: dict[int, Rng] = {}

    def batch(self, rows: Rows | None = None) -> RngBatch:
        """The streams of the given rows, or of all."""
        batch = self._begun()
        # Single draws have advanced some streams; the batch continues from there.
        if self._single:
            for row, rng in self._single.items():
                batch.words[row] = rng.word
            self._single = {}
        return batch if rows is None else batch.of(rows)

    def adopt(self, row: int, rng: Rng) -> None:
        """Let the stream of a row continue in the state of `rng`."""
        self._single[row] = rng

    def row(self, row: int) -> Rng:
        """The stream of one agent."""
        rng = self._single.get(row)
        if rng is None:
            rng = self._single[row] = self._of(row)
        return rng

    def _of(self, row: int) -> Rng:
        if self._batch is None and len(self._single) * _BEGIN_ALL < len(self._ids):
            return Rng.of(hash_of(self._ids[row]), self._key)
        return Rng(int(self._begun().words[row]))

    def _begun(self) -> RngBatch:
        if self._batch is None:
            if isinstance(self._ids, Ids):
                words = RngBatch.begin(self._ids.hashes, self._key)
            else:  # a single agent: faster without arrays
                begun = [Rng.of(hash_of(agent), self._key).word for agent in self._ids]
                words = np.array(begun, np.uint64)
            self._batch = RngBatch(words)
        return self._batch
