"""Assembles measurements to complete revolutions with equal steps."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_services.sensors.rplidar.packets import Count, Samples

LONGEST: Final = 32_768
"""Samples without the start of a revolution after which the data are discarded."""


class RevolutionBuffer:
    """Collects samples until a revolution is complete; the first partial one is discarded."""

    def __init__(self, count: Count) -> None:
        self._count = count
        self._parts: list[Samples] = []
        self._length = 0
        self._begun = False

    def add(self, samples: Samples) -> Iterator[Samples]:
        """The revolutions that end within these samples."""
        cuts = [0, *np.flatnonzero(samples.starts).tolist(), len(samples.angles)]
        for number, (begin, end) in enumerate(pairwise(cuts)):
            if number:
                yield from self._end()
                self._begun = True
            if self._begun and end > begin:
                self._gather(_part(samples, begin, end))

    def _end(self) -> Iterator[Samples]:
        if self._parts:
            yield Samples(
                np.concatenate([part.angles for part in self._parts]),
                np.concatenate([part.distances for part in self._parts]),
                np.concatenate([part.starts for part in self._parts]),
            )
        self._parts, self._length = [], 0

    def _gather(self, part: Samples) -> None:
        self._parts.append(part)
        self._length += len(part.angles)
        if self._length > LONGEST:
            self._count("endless turns")
            self._parts, self._length, self._begun = [], 0, False


def _part(samples: Samples, begin: int, end: int) -> Samples:
    rows = slice(begin, end)
    return Samples(samples.angles[rows], samples.distances[rows], samples.starts[rows])


def ranges(turn: Samples, beams: int) -> NDArray[np.float32]:
    """A revolution in equal steps, shape (beams,), metres: beam i at i·360/beams degrees.

    Counter-clockwise, unlike the lidar's own angles. Each sample belongs to the nearest beam, whose
    shortest hit counts; a beam without samples is 0.
    """
    hit = turn.distances > 0
    beam = np.rint(-turn.angles[hit] * (beams / 360.0)).astype(np.intp) % beams
    nearest = np.full(beams, np.inf)
    np.minimum.at(nearest, beam, turn.distances[hit])
    nearest[np.isinf(nearest)] = 0.0
    return nearest.astype(np.float32)
