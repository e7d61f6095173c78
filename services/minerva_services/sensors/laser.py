"""gLaser of Table 4: an event for each obstacle that a range finder measures.

A beam that meets nothing within range is no obstacle, and so no event in Table 4. It still says
something: that way is free. `clear` makes an event of it, where a world has a type for that.

What a range means, as drivers publish it (ROS REP 117 and older conventions):

| range                        | meaning                                                  |
|------------------------------|----------------------------------------------------------|
| above 0 and below range_max  | a hit                                                    |
| range_max and more, infinity | no return: nothing within range                          |
| 0, negative, -infinity, NaN  | invalid: too near, or no measurement; says nothing       |
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import MANY
from minerva_bus.grammar.types import Degrees, Metres, Seconds
from minerva_bus.world.beams import Reals, hits, no_returns
from minerva_bus.world.readings import Scan
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.event_factory import EventFactory, event_type


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
        clear: the event type for beams that meet nothing, with the same data; "" makes none.
        clear_range: metres of such a beam that count as free at most. A surface that is dark or far
            sends nothing back long before `range_max` of some sensors.

    """

    topics = ("scan",)

    def __init__(
        self,
        topic: str = "scan",
        event: str = "eLaser",
        every: int = 1,
        takes: str = "newest",
        nth: int = 1,
        clear: str = "",
        clear_range: float = 10.0,
    ) -> None:
        if every < 1:
            raise MisuseError(f"laser: every is {every}; expected a number of beams from 1")
        if not (math.isfinite(clear_range) and clear_range > 0):
            raise MisuseError(
                f"laser: clear_range is {clear_range}; expected metres, a number above 0"
            )
        if clear == event:
            raise MisuseError(
                f"laser: event and clear are both {event!r}; beams that hit and beams that meet"
                " nothing need two event types"
            )
        self.takes, self.nth = takes, nth
        self.topics = (topic,)
        self._event = event
        self._every = every
        self._clear = clear
        self._clear_range = clear_range
        self._timed = False

    def generates(self) -> tuple[str, ...]:
        return (self._event, self._clear) if self._clear else (self._event,)

    def joined(self, world: WorldInfo) -> None:
        declared = event_type("laser", world, self._event).fields.names
        self._timed = "time" in declared
        time = {"time": Seconds} if self._timed else {}
        self._obstacle = EventFactory(
            "laser", world, self._event, dist=Metres, angle=Degrees, **time
        )
        if self._clear:
            self._free = EventFactory("laser", world, self._clear, dist=Metres, angle=Degrees)

    def generate(self, tick: Tick) -> Iterable[AnyEvent]:
        for scan in tick.readings:
            if not isinstance(scan, Scan):
                raise MisuseError(
                    f"laser: expected scans on {self.topics[0]!r}, found {type(scan).__name__}"
                )
            columns = hits(scan, self._every)
            if self._timed:
                columns = (*columns, np.full(len(columns[0]), scan.time))
            yield from _events(self._obstacle, scan, columns)
            if self._clear:
                open_beams = no_returns(scan, self._clear_range, self._every)
                yield from _events(self._free, scan, open_beams)


def _events(maker: EventFactory, scan: Scan, columns: tuple[Reals, ...]) -> Iterator[AnyEvent]:
    """An event for each beam, from columns of its data, (n,) each."""
    if len(columns[0]) >= MANY:
        yield maker.many(columns, scan.robot)
        return
    for beam in zip(*[column.tolist() for column in columns], strict=True):
        yield maker(*beam, receivers=(scan.robot,))
