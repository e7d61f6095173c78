"""Contexts: the frame in which user code runs, its random streams, and emission of events.

Random streams are keyed by (seed, id, frame), so draws do not depend on where an agent runs. `Rng`
draws for one agent, `RngBatch` a number for each agent of a population. Both have the same
interface and draw the same numbers: SplitMix64 (portable/distributions.py), seeded for each agent
with a hash of the key. numpy's generators cannot be seeded for a million streams per frame.
`stream` is a numpy Generator with all of numpy's distributions.

Normal and exponential draws use `minerva_bus.portable`, because numpy's logarithm depends on the
processor. Of a numpy Generator, `random`, `uniform` and `integers` do not; `portable.normal`
converts their numbers to normal ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import blake2b
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent, Event, Events, check_number
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

if TYPE_CHECKING:
    from minerva_bus.world.population import Mask, Population


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


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame t of a world.

    Attributes:
        number: t, from 0.
        dt: its duration in simulated seconds.
        seed: the world's seed, from which all random numbers follow.

    """

    number: int = 0
    dt: float = 0.1
    seed: int = 0

    def __eq__(self, other: object) -> bool:
        # Views have the number as `frame`, so people write `tick.frame == 3`; it would never hold.
        if isinstance(other, int):
            raise MisuseError(f"a frame is not a number; write number == {other} without frame")
        if not isinstance(other, Frame):
            return NotImplemented
        return (self.number, self.dt, self.seed) == (other.number, other.dt, other.seed)


class FrameStreams:
    """All random streams of the agents with these ids in a frame."""

    __slots__ = ("_answers", "_frame", "_generators", "_ids", "draws")

    def __init__(self, ids: Ids | Sequence[str], frame: Frame) -> None:
        self._ids = ids
        self._frame = frame
        self._answers: dict[str, Streams] = {}
        self._generators: dict[str, np.random.Generator] = {}
        self.draws = Streams(ids, frame_key(frame.seed, frame.number))

    @property
    def alone(self) -> bool:
        """Whether these are the streams of a single agent."""
        return len(self._ids) == 1

    def answers(self, event_type: str) -> Streams:
        """The streams that decide which events of a type the agents respond to."""
        streams = self._answers.get(event_type)
        if streams is None:
            key = answer_key(self._frame.seed, self._frame.number, event_type)
            streams = self._answers[event_type] = Streams(self._ids, key)
        return streams

    def generator(self, who: str) -> np.random.Generator:
        """The numpy Generator of an agent (`#id`) or a generator (its name)."""
        generator = self._generators.get(who)
        if generator is None:
            generator = stream(self._frame.seed, who, self._frame.number)
            self._generators[who] = generator
        return generator


class InFrame:
    """Number, duration and time of the current frame."""

    __slots__ = ()
    frame: Frame

    @property
    def number(self) -> int:
        """The frame's number t, from 0."""
        return self.frame.number

    @property
    def dt(self) -> float:
        """Duration of a frame in simulated seconds."""
        return self.frame.dt

    @property
    def time(self) -> float:
        """Simulated seconds since the start of the world."""
        return self.frame.number * self.frame.dt


@dataclass(slots=True)
class Context(InFrame):
    """What a method may know and do in a frame: time, random numbers, `emit`. Called `moment`.

    It is the context of one agent or generator. `number`, `dt` (s) and `time` (s) are those of the
    frame; `random` is a numpy Generator, `chance` draws the same numbers as in a population.

    Attributes:
        frame: the frame.
        who: the generator's name, or `#id` for an agent.
        emitted: the events emitted so far.
        streams: the random streams that the agents of a population share; each has those of its
            `row`.
        row: the agent's row in `streams`.

    Example:
        >>> moment = Context(Frame(number=20, dt=0.1, seed=7), "#f1")
        >>> moment.time
        2.0
        >>> moment.emit(eCall(loud=moment.chance.uniform(0, 1)))

    """

    frame: Frame
    who: str
    emitted: list[Event] = field(default_factory=list[Event])
    streams: FrameStreams | None = None
    row: int = 0
    _rng: Rng | None = field(default=None, repr=False)
    _rng_row: int = field(default=0, repr=False)

    def shared_streams(self) -> FrameStreams:
        """The streams of the population, or of this agent alone."""
        if self.streams is None:
            self.streams = FrameStreams((self.who.removeprefix("#"),), self.frame)
            if self._rng is not None:
                # The agent has drawn already; its stream continues instead of beginning again.
                self.streams.draws.adopt(self.row, self._rng)
        return self.streams

    @property
    def random(self) -> np.random.Generator:
        """The numpy Generator of this agent or generator, keyed by (seed, id, frame)."""
        return self.shared_streams().generator(self.who)

    @property
    def chance(self) -> Rng:
        """The random numbers of this agent or generator, equal to those in a population."""
        rng = self._rng
        # Cached, because most methods draw several times, until the context moves to another row.
        if rng is None or self._rng_row != self.row:
            if self.streams is not None:
                rng = self.streams.draws.row(self.row)
            else:
                key = frame_key(self.frame.seed, self.frame.number)
                rng = Rng.of(hash_of(self.who.removeprefix("#")), key)
            self._rng, self._rng_row = rng, self.row
        return rng

    def batch(self, population: Population) -> BatchContext:
        """The context of a population that consists of this agent, with the same streams."""
        # Streams that were made for this agent only have no other rows.
        alone = self.streams is None or self.streams.alone
        rows = None if alone else np.array([self.row], np.intp)
        streams, self._rng = self.shared_streams(), None  # the stream advances in the batch
        return BatchContext(self.frame, streams.draws, population, rows)

    def answers(self, event_type: str, probability: float) -> bool:
        """Whether the agent responds to the next event of a type, with a probability.

        Each such event takes a number from the stream of (seed, agent, frame, type).
        """
        return self.shared_streams().answers(event_type).row(self.row).chance(probability)

    def emit(self, event: AnyEvent) -> None:
        """Emit an event or a batch into the next frame; the sender is the agent, if any.

        Raises:
            MisuseError: it is not an event, or the agent has made too many in this frame.

        """
        check_number(len(self.emitted))
        if isinstance(event, Events):
            for each in event:
                self.emit(each)
            return
        if not isinstance(event, Event):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise MisuseError(f"emit an event, such as eNear(distance=1.0), not {event!r}")
        if self.who.startswith("#"):
            sender, receivers = self.who[1:], event.receivers
            # The sender is set here, whatever the event has: an agent cannot send in another's
            # name.
            event = Event(event.type, event.names, event.values, event.condition, sender, receivers)
        self.emitted.append(event)


class BatchContext(InFrame):
    """The context of a population in a frame: the `moment` of methods with `population=True`.

    `number`, `dt` (s) and `time` (s) are those of the frame. `chance` draws a number for each
    agent, in arrays of shape (n,), equal to those that `Context.chance` draws for one agent.
    """

    __slots__ = ("_population", "_rows", "_streams", "frame")

    def __init__(
        self, frame: Frame, streams: Streams, population: Population, rows: Rows | None
    ) -> None:
        self.frame = frame
        self._streams = streams
        self._population = population
        self._rows = rows

    @property
    def chance(self) -> RngBatch:
        """The random numbers of the agents, each from the agent's own stream."""
        return self._streams.batch(self._rows)

    @property
    def random(self) -> Any:
        """Available to single agents only; raises MisuseError."""
        raise MisuseError(
            "moment.random is for one agent; a population draws from moment.chance, one number for"
            " each (a single agent may use it too, and gets the same numbers)"
        )

    def emit(self, event: AnyEvent, where: Mask = True) -> None:
        """Emit an event into the next frame from each agent where the mask is true.

        Args:
            event: an event, or a batch such as `eGive(amount=array, receivers=ids)` with a row for
                each agent or for each sender.
            where: bool, shape (n,), or one value for all.

        Raises:
            MisuseError: the numbers of rows differ.

        """
        self._population._emit(event, where)  # pyright: ignore[reportPrivateUsage]
