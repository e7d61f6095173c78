"""What a piece of user code may know of the frame that it runs in."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.events import Event
from minerva_bus.world.rng import Rng, answer_key, frame_key, hash_of, stream


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame t of a world: its number, the seconds that a frame lasts, the world's seed."""

    number: int = 0
    dt: float = 0.1
    seed: int = 0


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
    """A frame as one agent or generator lives it.

    `who` is the generator's name, or `#id` for an agent.
    """

    frame: Frame
    who: str
    emitted: list[Event] = field(default_factory=list[Event])
    _random: np.random.Generator | None = None
    _chance: Rng | None = None
    _answers: dict[str, Rng] | None = None

    @property
    def random(self) -> np.random.Generator:
        """The random stream of this agent or generator in this frame."""
        if self._random is None:
            self._random = stream(self.frame.seed, self.who, self.frame.number)
        return self._random

    def lent(
        self,
        chance: Rng | None,
        random: np.random.Generator | None,
        answers: dict[str, Rng],
    ) -> None:
        """Go on with these streams."""
        self._chance, self._random, self._answers = chance, random, answers

    def answers(self, event_type: str, probability: float) -> bool:
        """Whether an agent answers the next event of a type that it answers by chance.

        Drawn from a stream for each (seed, agent, frame, type), a number for each such event.
        """
        known = self._answers = self._answers if self._answers is not None else {}
        found = known.get(event_type)
        if found is None:
            key = answer_key(self.frame.seed, self.frame.number, event_type)
            found = known[event_type] = Rng.of(hash_of(self.who.removeprefix("#")), key)
        return found.chance(probability)

    @property
    def drawn(self) -> tuple[Rng | None, np.random.Generator | None]:
        """The streams that have been drawn from."""
        return self._chance, self._random

    @property
    def chance(self) -> Rng:
        """Single draws of this agent or generator in this frame; those of a population too."""
        if self._chance is None:
            who = self.who.removeprefix("#")
            self._chance = Rng.of(hash_of(who), frame_key(self.frame.seed, self.frame.number))
        return self._chance

    def emit(self, event: Event | Events) -> None:
        """Send an event; it belongs to the next frame. An agent's is marked with its id."""
        if isinstance(event, Events):
            for one in event:
                self.emit(one)
            return
        if not isinstance(event, Event):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise MisuseError(f"emit an event, such as eNear(distance=1.0), not {event!r}")
        if self.who.startswith("#"):
            event = replace(event, sender=self.who[1:])
        self.emitted.append(event)


Moment = Context
"""Former name."""
