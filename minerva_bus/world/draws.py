"""The random streams of agents in columns, whether they draw one by one or all at once."""

from __future__ import annotations

import numpy as np

from minerva_bus.grammar.ids import Ids
from minerva_bus.world.chance import Chance, Chances, frame_key
from minerva_bus.world.moment import Frame, Moment


class Draws:
    """Each agent's stream of a frame goes on where its last draw was, whichever form that had."""

    def __init__(self, ids: Ids, frame: Frame) -> None:
        self._ids = ids
        self._key = frame_key(frame.seed, frame.number)
        self._many: Chances | None = None
        self._single: dict[int, Chance] = {}
        self._streams: dict[int, np.random.Generator] = {}

    def many(self) -> Chances:
        """The streams of all."""
        if self._many is None:
            self._many = Chances(Chances.begin(self._ids.hashes, self._key))
            self.gather()
        return self._many

    def gather(self) -> None:
        """Take note of what single agents have drawn."""
        if self._many is not None and self._single:
            for row, chance in self._single.items():
                self._many.words[row] = chance.word
            self._single = {}

    def lend(self, row: int, moment: Moment) -> None:
        """Let one agent go on with its stream."""
        moment.lent(self._single.get(row), self._streams.get(row))
        if self._many is not None and row not in self._single:
            moment.lent(Chance(int(self._many.words[row])), self._streams.get(row))

    def take_back(self, row: int, moment: Moment) -> None:
        """Keep the stream of an agent that has drawn."""
        chance, stream = moment.drawn
        if chance is not None:
            self._single[row] = chance
        if stream is not None:
            self._streams[row] = stream
