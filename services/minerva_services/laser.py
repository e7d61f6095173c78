"""gLaser of Table 4: an event for each obstacle that a range finder measures."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import MANY
from minerva_bus.grammar.types import Degrees, Metres
from minerva_bus.world.beams import hits
from minerva_bus.world.readings import Scan
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.making import Maker


class Laser(Generator, events=("eLaser",)):
    """Turns scans into `eLaser(dist, angle)`, to the robot that carries the sensor.

    `dist` is in metres from the robot's centre, `angle` in degrees counter-clockwise from its
    heading, both as they were at the scan's first beam. It neither knows nor cares who publishes
    the scans (4.3).

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
            dist, angle = hits(scan, self._every)
            if len(dist) >= MANY:
                yield self._obstacle.many((dist, angle), scan.robot)
                continue
            for one in zip(dist.tolist(), angle.tolist(), strict=True):
                yield self._obstacle(*one, receivers=(scan.robot,))
