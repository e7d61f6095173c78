"""The random streams of agents in columns, whether they draw one by one or all at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.columns import Rows
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids
from minerva_bus.world.context import Context, Frame
from minerva_bus.world.rng import Rng, RngBatch, answer_key, frame_key, hash_of, stream

if TYPE_CHECKING:
    from minerva_bus.world.agent import Agent

_MOST = 16
"""When one of so many has drawn by itself, the streams of all are begun at once."""


class Streams:
    """Each agent's stream of a frame goes on where its last draw was, whichever form that had."""

    def __init__(self, ids: Ids, frame: Frame) -> None:
        self._ids = ids
        self._frame = frame
        self._key = frame_key(frame.seed, frame.number)
        self._many: RngBatch | None = None
        self._single: dict[int, Rng] = {}
        self._streams: dict[int, np.random.Generator] = {}
        self._answers: dict[str, RngBatch] = {}

    def many(self) -> RngBatch:
        """The streams of all."""
        if self._many is None:
            self._many = RngBatch(RngBatch.begin(self._ids.hashes, self._key))
            self.gather()
        return self._many

    def gather(self) -> None:
        """Take note of what single agents have drawn."""
        if self._many is not None and self._single:
            for row, chance in self._single.items():
                self._many.words[row] = chance.word
            self._single = {}

    def single(self, row: int) -> Rng:
        """The stream of one agent."""
        chance = self._single.get(row)
        if chance is None:
            chance = self._single[row] = self._begun(row)
        return chance

    def _begun(self, row: int) -> Rng:
        if self._many is None and len(self._single) * _MOST < len(self._ids):
            return Rng.of(hash_of(self._ids[row]), self._key)
        if self._many is None:
            self._many = RngBatch(RngBatch.begin(self._ids.hashes, self._key))
        return Rng(int(self._many.words[row]))

    def stream(self, row: int) -> np.random.Generator:
        """The other stream of one agent, with all of numpy's distributions."""
        found = self._streams.get(row)
        if found is None:
            who = f"#{self._ids[row]}"
            found = self._streams[row] = stream(self._frame.seed, who, self._frame.number)
        return found

    def answers(self, event_type: str, rows: Rows | None, probability: Any) -> NDArray[np.bool_]:
        """Which of some rows answer the next event of a type that they answer by chance."""
        found = self._answers.get(event_type)
        if found is None:
            key = answer_key(self._frame.seed, self._frame.number, event_type)
            found = self._answers[event_type] = RngBatch(RngBatch.begin(self._ids.hashes, key))
        return found.of(rows).chance(probability)

    def lend(self, row: int, moment: Context) -> None:
        """Let one agent go on with its streams for good."""
        drawn = row in self._single or self._many is not None
        answers = {one: Rng(int(many.words[row])) for one, many in self._answers.items()}
        moment.lent(self.single(row) if drawn else None, self._streams.get(row), answers)


class RowContext(Context):
    """A frame as many agents live it, one after another: `agent`, in its `row`, at a time."""

    __slots__ = ("_draws", "agent", "row")

    def __init__(self, frame: Frame, draws: Streams) -> None:
        self.frame = frame
        self.emitted = []
        self._draws = draws
        self.agent: Any = None
        self.row = 0

    @property
    def who(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The agent's name in messages."""
        agent: Agent = self.agent
        return f"#{agent.id}"

    @property
    def random(self) -> np.random.Generator:
        """The random stream of this agent in this frame."""
        return self._draws.stream(self.row)

    @property
    def chance(self) -> Rng:
        """Single draws of this agent in this frame; those of a population too."""
        return self._draws.single(self.row)

    def emit(self, event: Event | Events) -> None:
        """Send an event; it belongs to the next frame, and is marked with the agent's id."""
        if type(event) is not Event:
            super().emit(event)
            return
        names, values, to = event.names, event.values, event.receivers
        self.emitted.append(Event(event.type, names, values, event.condition, self.agent.id, to))
