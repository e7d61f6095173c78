"""A robot that corrects its odometry by matching laser scans against its own map.

| event   | in addition to ARobot                                                                |
  |---------|--------------------------------------------------------------------------------------|
  | eLaser  | buffers the hit, because a scan can only be matched as a whole                       |
  | eClear  | buffers the beam until the pose is corrected                                         |
  | eCamera | corrects the pose, draws the scan, then marks the marker                             |
  | eDecide | likewise, unless a marker came first; each frame needs its decision after eLaser     |

Grid, pose and plans are the robot's own; it receives no external position. `matching` corrects the
pose within the uncertainty of the last move.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.knowledge import clear_open_beam, clearing_part
from minerva_agents.robot.matching import Uncertainty, match
from minerva_agents.robot.motion import Reals, at_distance, at_distances, wrapped
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.scans import mark_scan
from minerva_bus import Context, Degrees, Event, EventBatch, Metres, on, portable


def filled(dist: Reals, angle: Reals, max_gap: float) -> tuple[Reals, Reals]:
    """The hits, plus points one cell apart between neighbours at most `max_gap` cells apart.

    Distances are cells, angles degrees, (n,) each. A laser with few beams samples a wall sparsely,
    and without interpolation a scan would fit best where its points coincide with those of the
    previous scan. A laser with many beams needs none: interpolation would round off corners.
    """
    cos, sin = portable.cos_sin(np.radians(angle))
    down, right = dist * cos, dist * sin
    far_down, far_right = np.roll(down, -1) - down, np.roll(right, -1) - right
    gaps = portable.hypot(far_down, far_right)
    counts = np.where(gaps <= max_gap, np.maximum(np.ceil(gaps), 1), 1).astype(np.intp)
    which = np.repeat(np.arange(len(dist)), counts)
    firsts = np.cumsum(counts) - counts
    parts = (np.arange(len(which)) - firsts[which]) / counts[which]
    down, right = down[which] + parts * far_down[which], right[which] + parts * far_right[which]
    return portable.hypot(down, right), np.degrees(portable.atan2(right, down))


_MAX_GAP: Final = 0.6
"""Maximum gap in metres between neighbouring hits on one wall."""

_KEY_DEGREES: Final = 30.0
_KEY_METRES: Final = 0.25
"""Degrees and metres after which a scan is drawn. Drawing every matched scan would make the map
follow the robot's errors instead of correcting them."""


class ALocalisingRobot(ARobot, symbol="ALocalisingRobot"):
    """A robot that corrects its pose before it draws what it sees.

    Attributes in addition to ARobot's:
        turned: total rotation since the last drawn scan.
        driven: distance travelled since then.
    """

    turned: Degrees = 0.0
    driven: Metres = 0.0

    # Not part of the state, because these buffers are empty between two frames.
    _hits: tuple[tuple[float, float], ...] = ()
    _misses: tuple[tuple[float, float], ...] = ()

    @on("eLaser", together=True, population=False)
    def sense_obstacle(self, laser: EventBatch | Event, moment: Context) -> None:
        """Buffer (metres, degrees) of hits until the scan is complete, in the same frame."""
        self._hits = (*self._hits, *_beams(laser))

    @on("eClear", together=True, population=False)
    def sense_free(self, beam: EventBatch | Event, moment: Context) -> None:
        """Buffer (metres, degrees) of beams without a hit until the scan is complete."""
        self._misses = (*self._misses, *_beams(beam))

    def sense_marker(self, camera: Event, moment: Context) -> None:
        """g', after the pose is corrected."""
        self._localise(moment)
        super().sense_marker(camera, moment)

    def decide(self, event: Event, moment: Context) -> None:
        """r', c', ang', act', after the pose is corrected."""
        self._localise(moment)
        before = self.pose
        super().decide(event, moment)
        # From this motion follows the uncertainty of the next match.
        self.turned += abs(wrapped(self.angle - before.angle))
        gone = portable.hypot(self.row - before.row, self.column - before.column)
        self.driven += float(gone) * self.cell

    def _localise(self, moment: Context) -> None:
        """Correct the pose by the buffered scan, and draw the scan after enough motion."""
        hits, misses = self._in_cells(self._hits), self._in_cells(self._misses)
        self._hits, self._misses = (), ()
        if not len(hits) and not len(misses):
            return
        # A robot at rest draws every scan at the same pose, which cannot distort the map.
        if self.turned or self.driven:
            self._correct(hits)
            if self.turned < _KEY_DEGREES and self.driven < _KEY_METRES:
                return
            self.turned = self.driven = 0.0
        self._draw(hits, misses, clearing_part(moment.number))

    def _in_cells(self, beams: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
        """(n, 2): distance in cells, angle in degrees."""
        # Without beams, the array would have one dimension only.
        return np.array(beams, np.float64).reshape(-1, 2) / (self.cell, 1.0)

    def _correct(self, hits: NDArray[np.float64]) -> None:
        """Move to the pose at which the hits match the map best.

        Without hits there is no evidence.
        """
        if not len(hits):
            return
        uncertainty = Uncertainty.after(self.turned, self.driven)
        walls = filled(hits[:, 0], hits[:, 1], _MAX_GAP / self.cell)
        best = match(self.grid, self.pose, walls, self.cell, uncertainty)
        self.row, self.column, self.angle = best.row, best.column, wrapped(best.angle)

    def _draw(self, hits: NDArray[np.float64], misses: NDArray[np.float64], part: float) -> None:
        grid, row, column = self.writable("grid"), self.row, self.column
        ends = at_distances(row, column, self.angle + hits[:, 1], hits[:, 0])
        mark_scan(grid, row, column, *ends, part)
        for dist, angle in misses.tolist():
            to = at_distance(row, column, self.angle + angle, dist)
            clear_open_beam(grid, row, column, *to, part)


def _beams(event: EventBatch | Event) -> Iterator[tuple[float, float]]:
    """Distances in metres and angles in degrees."""
    dist, angle = np.atleast_1d(event.dist), np.atleast_1d(event.angle)
    return zip(dist.tolist(), angle.tolist(), strict=True)
