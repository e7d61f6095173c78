"""gLaser of Table 4: an event for each obstacle that a range finder measures."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import MANY
from minerva_bus.grammar.types import Degrees, Metres, Seconds
from minerva_bus.world.beams import hits
from minerva_bus.world.readings import Scan
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.making import Maker, event_type


class Laser(Generator, events=("eLaser",)):
    """Turns scans into `eLaser(dist, angle)`, to the robot that carries the sensor.

    `dist` is in metres from the robot's centre, `angle` in degrees counter-clockwise from its
    heading, both as they were at the scan's first beam. It neither knows nor cares who publishes
    the scans (4.3).

    Events of a frame that are equal are one event (eq. 6). Within a scan no two beams are equal,
    for each has its own angle. Scans of one frame may have equal beams, where `takes` is "all" or
    several lasers make the same event. A world that counts hits declares `time` (Seconds) in the
    event type as well: it is filled with the time of the scan, which keeps them apart.

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
        declared = event_type("laser", world, self._event).fields.names
        self._timed = "time" in declared
        time = {"time": Seconds} if self._timed else {}
        self._obstacle = Maker("laser", world, self._event, dist=Metres, angle=Degrees, **time)

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        for scan in tick.readings:
            if not isinstance(scan, Scan):
                raise MisuseError(
                    f"laser: expected scans on {self.topics[0]!r}, found {type(scan).__name__}"
                )
            columns = hits(scan, self._every)
            if self._timed:
                columns = (*columns, np.full(len(columns[0]), scan.time))
            if len(columns[0]) >= MANY:
                yield self._obstacle.many(columns, scan.robot)
                continue
            for beam in zip(*[column.tolist() for column in columns], strict=True):
                yield self._obstacle(*beam, receivers=(scan.robot,))
