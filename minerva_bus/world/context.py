"""What user code may know and do in the frame in which it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.events import Event
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
    """One frame t of a world: its number, its duration `dt` in seconds, and the world's seed."""

    number: int = 0
    dt: float = 0.1
    seed: int = 0


class FrameStreams:
    """All random streams of some agents in a frame."""

    __slots__ = ("_answers", "_frame", "_generators", "_ids", "draws")

    def __init__(self, ids: Ids | Sequence[str], frame: Frame) -> None:
        self._ids = ids
        self._frame = frame
        self._answers: dict[str, Streams] = {}
        self._generators: dict[str, np.random.Generator] = {}
        self.draws = Streams(ids, frame_key(frame.seed, frame.number))

    @property
    def alone(self) -> bool:
        """Whether these are the streams of one agent."""
        return len(self._ids) == 1

    def answers(self, event_type: str) -> Streams:
        """The streams that decide which events of a type are answered by chance."""
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
    """When a piece of user code runs."""

    __slots__ = ()
    frame: Frame

    @property
    def number(self) -> int:
        """The frame's number t, from 0."""
        return self.frame.number

    @property
    def dt(self) -> float:
        """Simulated seconds that a frame lasts."""
        return self.frame.dt

    @property
    def time(self) -> float:
        """Simulated seconds since the world began."""
        return self.frame.number * self.frame.dt


@dataclass(slots=True)
class Context(InFrame):
    """A frame as one agent or generator sees it.

    `who` is the generator's name, or `#id` for an agent. The agents of a population share the
    random streams of the frame: each has those in its `row`.
    """

    frame: Frame
    who: str
    emitted: list[Event] = field(default_factory=list[Event])
    streams: FrameStreams | None = None
    row: int = 0
    _rng: Rng | None = field(default=None, repr=False)

    def enter(self, row: int, agent_id: str) -> None:
        """Continue as the agent with this id, which has the streams in this row."""
        self.row, self.who, self._rng = row, "#" + agent_id, None

    def shared_streams(self) -> FrameStreams:
        """The streams that this one is among; those of it alone unless others were given."""
        if self.streams is None:
            self.streams = FrameStreams((self.who.removeprefix("#"),), self.frame)
            if self._rng is not None:
                self.streams.draws.adopt(self.row, self._rng)
        return self.streams

    @property
    def random(self) -> np.random.Generator:
        """The numpy Generator of this agent or generator in this frame."""
        return self.shared_streams().generator(self.who)

    @property
    def chance(self) -> Rng:
        """The draws of this agent or generator in this frame; equal to those of a population."""
        rng = self._rng
        if rng is None:  # kept, because most methods draw several times
            if self.streams is not None:
                rng = self.streams.draws.row(self.row)
            else:
                key = frame_key(self.frame.seed, self.frame.number)
                rng = Rng.of(hash_of(self.who.removeprefix("#")), key)
            self._rng = rng
        return rng

    def batch(self, population: Population) -> BatchContext:
        """The same frame for a population of this one agent, with the same streams."""
        alone = self.streams is None or self.streams.alone
        rows = None if alone else np.array([self.row], np.intp)
        streams, self._rng = self.shared_streams(), None  # its stream moves on in the batch
        return BatchContext(self.frame, streams.draws, population, rows)

    def answers(self, event_type: str, probability: float) -> bool:
        """Whether an agent answers the next event of a type that it answers by chance.

        Takes a number for each such event from a stream for each (seed, agent, frame, type).
        """
        return self.shared_streams().answers(event_type).row(self.row).chance(probability)

    def emit(self, event: AnyEvent) -> None:
        """Send an event, or several; they belong to the next frame. An agent's carry its id."""
        if isinstance(event, Events):
            for each in event:
                self.emit(each)
            return
        if not isinstance(event, Event):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise MisuseError(f"emit an event, such as eNear(distance=1.0), not {event!r}")
        if self.who.startswith("#"):
            sender, receivers = self.who[1:], event.receivers
            event = Event(event.type, event.names, event.values, event.condition, sender, receivers)
        self.emitted.append(event)


class BatchContext(InFrame):
    """A frame as many agents see it at once; `rows` are theirs in the streams, None: all."""

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
        """The agents' draws: one number for each, from its own stream."""
        return self._streams.batch(self._rows)

    @property
    def random(self) -> Any:
        """A single agent has it; a population has not."""
        raise MisuseError(
            "moment.random is for one agent; a population draws from moment.chance, one number for"
            " each (a single agent may use it too, and gets the same numbers)"
        )

    def emit(self, event: AnyEvent, where: Mask = True) -> None:
        """Send an event from each agent where the mask is true; they belong to the next frame.

        `eGive(amount=array, receivers=ids)` has a row for each of the agents, or for each sender.
        """
        self._population._emit(event, where)  # pyright: ignore[reportPrivateUsage]


Moment = Context
"""Former name."""
