"""By how much the clocks of lidar and odometry differ, judged by the sharpness of walls.

Where a robot turns, a wrong time rotates its scans, and they see one wall in many places. With the
right offset, the same hits are in the fewest cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.log.recordings import CORRECTION, POSE, STEP_SECONDS, Recorded
from minerva_bus.values import fast_dataclass
from minerva_bus.world.readings import Odometry, Scan

_FARTHEST: Final = 0.5
"""Largest offset in seconds that is tried."""

_STEPS: Final = (0.05, 0.01)
"""Seconds between offsets: over all of the range, and around the best of these."""

_FEWER: Final = 0.9
"""Fraction of the cells that a better offset must not exceed."""

_GROUP: Final = 100
"""Successive scans that are compared; over longer times odometry drifts."""

_GROUPS: Final = 4
_BEAMS: Final = 180
"""Most groups, and beams of a scan, that are compared."""

Reals = NDArray[np.float64]


@fast_dataclass
class Sharper:
    """An offset in seconds, and the number of cells hit with it as a fraction of that without."""

    offset: float
    cells: float


class OffsetEstimator:
    """Collects scans and odometry from a stream of readings.

    It starts over after a step of the clock. Of several topics with odometry, the first counts.
    """

    def __init__(self) -> None:
        self._scans: list[Scan] = []
        self._times: list[float] = []
        self._places: list[tuple[float, float, float]] = []
        self._topic = ""

    def watched(self, readings: Iterable[Recorded]) -> Iterator[Recorded]:
        """The readings, unchanged."""
        for recorded in readings:
            reading = recorded.reading
            if isinstance(reading, Scan):
                self._scans.append(reading)
            elif isinstance(reading, Odometry) and recorded.topic not in (POSE, CORRECTION):
                self._topic = self._topic or recorded.topic
                if recorded.topic == self._topic:
                    self._moved(reading)
            yield recorded

    def _moved(self, odometry: Odometry) -> None:
        if self._times and odometry.time < self._times[-1] - STEP_SECONDS:
            self._scans.clear()
            self._times.clear()
            self._places.clear()
        if not self._times or odometry.time > self._times[-1]:
            self._times.append(odometry.time)
            self._places.append((odometry.x, odometry.y, odometry.angle))

    def sharper(self, cell: float) -> Sharper | None:
        """A better offset of the times; None if there is none. `cell` is its side in metres."""
        groups = [_Beams.of(scans) for scans in self._turning()]
        if not groups:
            return None
        x, y, angle = np.array(self._places).T
        track = np.array(self._times), x, y, np.unwrap(angle, period=360.0)

        def cells(offset: float) -> int:
            return sum(group.cells(offset, track, cell) for group in groups)

        best = 0.0
        for reach, step in ((_FARTHEST, _STEPS[0]), (_STEPS[0], _STEPS[1])):
            number = round(reach / step)
            tried = [best + step * each for each in range(-number, number + 1)]
            best = min(tried, key=lambda offset: (cells(offset), abs(offset)))
            # A minimum at the end of the range is none.
            if step == _STEPS[0] and best in (tried[0], tried[-1]):
                return None
        # Between two readings of odometry, the motion is not known.
        is_measured = abs(best) > np.median(np.diff(track[0]))
        agreed = all(
            group.cells(best, track, cell) < group.cells(0.0, track, cell) for group in groups
        )
        ratio = cells(best) / max(1, cells(0.0))
        is_better = is_measured and agreed and ratio < _FEWER
        return Sharper(round(best, 2), ratio) if is_better else None

    def _turning(self) -> list[list[Scan]]:
        """The groups of scans during which the robot turns most."""
        if len(self._times) < 2:
            return []
        reach = _FARTHEST + _STEPS[0]
        begin, end = self._times[0] + reach, self._times[-1] - reach
        inside = [
            scan
            for scan in self._scans
            if begin < scan.time < end
            and begin < scan.time + len(scan.ranges) * scan.beam_time < end
        ]
        groups = [inside[start : start + _GROUP] for start in range(0, len(inside), _GROUP)]
        angles = np.unwrap([angle for _, _, angle in self._places], period=360.0)
        turned = np.cumsum(np.abs(np.diff(angles)))

        def turn(group: list[Scan]) -> float:
            first, last = np.interp([group[0].time, group[-1].time], self._times[1:], turned)
            return float(last - first)

        return sorted(groups, key=turn, reverse=True)[:_GROUPS]


@dataclass(frozen=True, slots=True, eq=False)
class _Beams:
    """The beams of scans that hit something: one value of each, in seconds, metres and degrees."""

    times: Reals
    far: Reals
    angles: Reals
    mount_x: Reals
    mount_y: Reals

    @staticmethod
    def of(scans: Sequence[Scan]) -> _Beams:
        """Some beams of each scan."""
        columns: list[Reals] = []
        for scan in scans:
            beams = np.arange(0, len(scan.ranges), -(-len(scan.ranges) // _BEAMS))
            far = scan.ranges[beams].astype(np.float64)
            hit = (far > 0) & (far < scan.range_max)
            beams, far = beams[hit], far[hit]
            angles = scan.mount_angle + scan.first + beams * scan.step
            mount = np.full((2, len(far)), [[scan.mount_x], [scan.mount_y]])
            columns.append(np.vstack([scan.time + beams * scan.beam_time, far, angles, mount]))
        return _Beams(*np.concatenate(columns, axis=1))

    def cells(self, offset: float, track: tuple[Reals, Reals, Reals, Reals], cell: float) -> int:
        """The number of cells that are hit, with an offset of the times."""
        known, *places = track
        x, y, angle = (np.interp(self.times + offset, known, each) for each in places)
        turn, ahead = np.radians(angle), np.radians(angle + self.angles)
        cos, sin = portable.cos(turn), portable.sin(turn)
        x += cos * self.mount_x - sin * self.mount_y + self.far * portable.cos(ahead)
        y += sin * self.mount_x + cos * self.mount_y + self.far * portable.sin(ahead)
        columns, rows = (np.floor(each / cell).astype(np.int64) for each in (x, y))
        return len(np.unique((columns << 32) + rows))
