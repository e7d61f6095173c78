"""Contexts: the frame in which user code runs, its random streams, and emission of events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent, Event, Events, check_number
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.rng import (
    Rng,
    RngBatch,
    Rows,
    Streams,
    answer_key,
    frame_key,
    hash_of,
    stream,
)

if TYPE_CHECKING:
    from minerva_bus.world.population import Mask, Population


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
