"""A robot that does not trust its wheels: it finds itself on its own map by its laser.

| event   | what it does besides ARobot                                                          |
|---------|--------------------------------------------------------------------------------------|
| eLaser  | keeps the hit, for a scan can only be matched as a whole                             |
| eClear  | keeps the beam, until the pose is right                                              |
| eCamera | corrects its pose by the scan first, then draws it, then marks the marker            |
| eDecide | likewise, if no marker has come first; so each frame needs its decision after eLaser |

The grid, the pose and the plans are the robot's own, as ever; nobody tells it where it is. What
corrects the pose is `matching`, with the errors that the last move may have had.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.filling import filled
from minerva_agents.robot.knowledge import (
    at_distance,
    clear_beam,
    clear_open_beam,
    mark_obstacle,
    part_that_counts,
)
from minerva_agents.robot.matching import Doubt, match
from minerva_agents.robot.motion import wrapped
from minerva_agents.robot.robot import ARobot
from minerva_bus import Context, Degrees, Event, Metres, portable

_GAP: Final = 0.6
"""Metres between two neighbouring hits up to which they are taken to be on one wall."""

_TURN: Final = 30.0
_WAY: Final = 0.25
"""Degrees and metres after which a scan is drawn. Were each one drawn that is matched, the map
would follow the robot's errors, instead of correcting them."""


class ALocalisingRobot(ARobot, symbol="ALocalisingRobot"):
    """A robot that looks where it is before it draws what it sees.

    What it needs besides an ARobot's attributes:
        turned: how far it has turned since it has last drawn a scan, to either side.
        driven: how far it has gone since.
    """

    turned: Degrees = 0.0
    driven: Metres = 0.0

    _hits: tuple[tuple[float, float], ...] = ()
    _misses: tuple[tuple[float, float], ...] = ()

    def sense_obstacle(self, laser: Event, moment: Context) -> None:
        """Remember (distance in metres, degrees) until the scan is whole, in the same frame."""
        self._hits = (*self._hits, (laser.dist, laser.angle))

    def sense_free(self, beam: Event, moment: Context) -> None:
        """Remember (distance in metres, degrees) of a beam that met nothing, likewise."""
        self._misses = (*self._misses, (beam.dist, beam.angle))

    def sense_marker(self, camera: Event, moment: Context) -> None:
        """g', after the pose is right."""
        self._find_itself(moment)
        super().sense_marker(camera, moment)

    def decide(self, event: Event, moment: Context) -> None:
        """r', c', ang', act', after the pose is right."""
        self._find_itself(moment)
        before = self.pose
        super().decide(event, moment)
        self.turned += abs(wrapped(self.angle - before.angle))
        gone = portable.hypot(self.row - before.row, self.column - before.column)
        self.driven += float(gone) * self.cell

    def _find_itself(self, moment: Context) -> None:
        """Correct the pose by the scan, and take the scan into the grid if it has some news."""
        hits, misses = self._in_cells(self._hits), self._in_cells(self._misses)
        self._hits, self._misses = (), ()
        if not len(hits) and not len(misses):
            return
        if self.turned or self.driven:
            self._correct(hits)
            if self.turned < _TURN and self.driven < _WAY:
                return
            self.turned = self.driven = 0.0
        self._draw(hits, misses, part_that_counts(moment.number))

    def _in_cells(self, beams: tuple[tuple[float, float], ...]) -> NDArray[np.float64]:
        """Rows of distances in cells and angles in degrees, (n, 2)."""
        return np.array(beams, np.float64).reshape(-1, 2) / (self.cell, 1.0)

    def _correct(self, hits: NDArray[np.float64]) -> None:
        """Stand where the hits fit the map best; a scan without hits fits anywhere."""
        if not len(hits):
            return
        doubt = Doubt.after(self.turned, self.driven)
        walls = filled(hits[:, 0], hits[:, 1], _GAP / self.cell)
        best = match(self.grid, self.pose, walls, self.cell, doubt)
        self.row, self.column, self.angle = best.row, best.column, wrapped(best.angle)

    def _draw(self, hits: NDArray[np.float64], misses: NDArray[np.float64], part: float) -> None:
        grid, row, column = self.writable("grid"), self.row, self.column
        for dist, angle in hits.tolist():
            to = at_distance(row, column, self.angle + angle, dist)
            clear_beam(grid, row, column, *to, part)
            mark_obstacle(grid, *to)
        for dist, angle in misses.tolist():
            to = at_distance(row, column, self.angle + angle, dist)
            clear_open_beam(grid, row, column, *to, part)
