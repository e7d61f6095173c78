"""gLaser of Table 4: an event for each obstacle that a range finder measures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.types import Degrees, Metres
from minerva_bus.world.readings import Scan
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.making import Maker


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
        # Which topic is up to each world, so this one hides its class's.
        self.topics = (topic,)  # pyright: ignore[reportAttributeAccessIssue]
        self._event = event
        self._every = every

    def generates(self) -> tuple[str, ...]:
        return (self._event,)

    def joined(self, world: WorldInfo) -> None:
        self._obstacle = Maker("laser", world, self._event, dist=Metres, angle=Degrees)

    def generate(self, tick: Tick) -> Iterable[Event]:
        for scan in tick.readings:
            if not isinstance(scan, Scan):
                raise MisuseError(
                    f"laser: expected scans on {self.topics[0]!r}, found {type(scan).__name__}"
                )
            to = (scan.robot,)
            for dist, angle in _from_centre(scan, _hits(scan, self._every)):
                yield self._obstacle(dist, angle, receivers=to)


def _hits(scan: Scan, every: int) -> Iterator[tuple[float, float]]:
    """Distance in metres and angle in degrees, from the sensor, of each beam that hit."""
    ranges, first, step = scan.ranges[::every], float(scan.first), float(scan.step) * every
    # The limit as float32 too, or a beam that reads just the limit might seem to be below it.
    beams = np.flatnonzero((ranges > 0) & (ranges < np.float32(scan.range_max)))
    for beam, dist in zip(beams.tolist(), ranges[beams].tolist(), strict=True):
        yield dist, first + beam * step


def _from_centre(scan: Scan, hits: Iterable[tuple[float, float]]) -> Iterable[tuple[float, float]]:
    """The same hits, from the robot's centre and heading."""
    x, y, turn = scan.mount_x, scan.mount_y, scan.mount_angle
    if not (x or y or turn):
        return hits
    if not (x or y):
        return ((dist, angle + turn) for dist, angle in hits)
    return (_moved(dist, angle + turn, x, y) for dist, angle in hits)


def _moved(dist: float, angle: float, x: float, y: float) -> tuple[float, float]:
    heading = math.radians(angle)
    x, y = x + dist * math.cos(heading), y + dist * math.sin(heading)
    return math.hypot(x, y), math.degrees(math.atan2(y, x))
