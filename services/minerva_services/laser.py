"""gLaser of Table 4: an event for each obstacle that a range finder measures."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import MANY
from minerva_bus.grammar.types import Degrees, Metres
from minerva_bus.world.readings import Scan
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.making import Maker

Reals: TypeAlias = NDArray[np.float64]


class Laser(Generator, events=("eLaser",)):
    """Turns scans into `eLaser(dist, angle)`, to the robot that carries the sensor.

    `dist` is in metres from the robot's centre, `angle` in degrees counter-clockwise from its
    heading. It neither knows nor cares who publishes the scans (4.3).

    Args:
        topic: the sensor topic of the scans.
        event: the event type; several range sensors may make the same, or each its own.
        every: only every so many-th beam, beginning with the first.
        takes: of scans that come faster than frames, "newest" counts, or "all" of them.
        nth: of scans that come freely, only every n-th counts.

    """

    topics = ("scan",)

    def __init__(
        self,
        topic: str = "scan",
        event: str = "eLaser",
        every: int = 1,
        takes: str = "newest",
        nth: int = 1,
    ) -> None:
        if every < 1:
            raise MisuseError(f"laser: every is {every}; expected a number of beams from 1")
        self.takes, self.nth = takes, nth
        self.topics = (topic,)
        self._event = event
        self._every = every

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def joined(self, world: WorldInfo) -> None:
        self._obstacle = Maker("laser", world, self._event, dist=Metres, angle=Degrees)

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        for scan in tick.readings:
            if not isinstance(scan, Scan):
                raise MisuseError(
                    f"laser: expected scans on {self.topics[0]!r}, found {type(scan).__name__}"
                )
            dist, angle = _from_centre(scan, *_hits(scan, self._every))
            if len(dist) >= MANY:
                yield self._obstacle.many((dist, angle), scan.robot)
                continue
            for one in zip(dist.tolist(), angle.tolist(), strict=True):
                yield self._obstacle(*one, receivers=(scan.robot,))


def _hits(scan: Scan, every: int) -> tuple[Reals, Reals]:
    """Distance in metres and angle in degrees, from the sensor, of each beam that hit."""
    ranges, first, step = scan.ranges[::every], float(scan.first), float(scan.step) * every
    # The limit as float32 too, or a beam that reads just the limit might seem to be below it.
    beams = np.flatnonzero((ranges > 0) & (ranges < np.float32(scan.range_max)))
    return ranges[beams].astype(np.float64), first + beams.astype(np.float64) * step


def _from_centre(scan: Scan, dist: Reals, angle: Reals) -> tuple[Reals, Reals]:
    """The same hits, from the robot's centre and heading."""
    x, y, turn = scan.mount_x, scan.mount_y, scan.mount_angle
    angle = angle + turn
    if not (x or y):
        return dist, angle
    heading = np.radians(angle)
    ahead, left = x + dist * np.cos(heading), y + dist * np.sin(heading)
    return np.hypot(ahead, left), np.degrees(np.arctan2(left, ahead))
