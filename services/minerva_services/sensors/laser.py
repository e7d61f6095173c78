"""gLaser of Table 4: an event for each obstacle that a range finder measures.

A beam without a hit is not an obstacle and therefore not an event in Table 4. It still carries
information: that direction is free. `clear` turns it into an event, if a world has a type for it.

Meaning of ranges, as published by drivers (ROS REP 117 and older conventions):

  | range                        | meaning                                                  |
  |------------------------------|----------------------------------------------------------|
  | above 0 and below range_max  | a hit                                                    |
  | range_max and more, infinity | no return: nothing within range                          |
  | 0, negative, -infinity, NaN  | invalid: too close, or no measurement; ignored           |
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import MANY
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.types import Degrees, Metres, Seconds
from minerva_bus.world.readings import Reals, Scan, ends, hits
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.event_factory import EventFactory, event_type


class Laser(Generator, events=("eLaser",)):
    """Turns scans into `eLaser(dist, angle)`, for the robot that carries the sensor.

    `dist` is in metres from the robot's centre, `angle` in degrees counter-clockwise from its
    heading, both at the time of the scan's first beam. The publisher of the scans is irrelevant
    (4.3).

    Equal events of a frame are one event (eq. 6). Beams of one scan differ by their angles. Scans
    of one frame may have equal beams if `takes` is "all" or several lasers share an event type. A
    world that counts hits declares `time` (Seconds) in the event type; it is set to the time of the
    scan, which keeps such events distinct.

    Args:
        topic: the sensor topic of the scans.
        event: the event type; several range sensors may share one, or use one each.
        every: use only every n-th beam, starting with the first.
        takes: of scans that arrive faster than frames, use the "newest" or "all".
        nth: of scans that arrive asynchronously, use only every n-th.
        clear: the event type for beams without a hit, with the same data; "": none.
        clear_range: maximum length in metres of such a beam that counts as free. Dark or distant
          surfaces return nothing long before `range_max` of some sensors.

    """

    topics = ("scan",)
    by_agent = True

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
            raise MisuseError(f"laser: every is {every}; expected an integer >= 1")
        if not (math.isfinite(clear_range) and clear_range > 0):
            raise MisuseError(
                f"laser: clear_range is {clear_range}; expected metres, a number above 0"
            )
        if clear == event:
            raise MisuseError(
                f"laser: event and clear are both {event!r}; beams that hit and beams that meet"
                " nothing require two event types"
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

    def check(self, world: WorldInfo) -> None:
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


def _events(factory: EventFactory, scan: Scan, columns: tuple[Reals, ...]) -> Iterator[AnyEvent]:
    """One event per beam, from columns of its data, (n,) each."""
    # A small batch costs more than the single events that it replaces.
    if len(columns[0]) >= MANY:
        yield factory.many(columns, scan.robot)
        return
    for beam in zip(*[column.tolist() for column in columns], strict=True):
        yield factory(*beam, receivers=(scan.robot,))


def no_returns(scan: Scan, most: float, every: int = 1) -> tuple[Reals, Reals]:
    """As `hits`, for beams without an obstacle in range, free for at most `most` metres.

    Without a positive `range_max` there are none, because such a sensor cannot report them.
    """
    free = min(scan.range_max, most)
    if not free > 0:
        return np.empty(0), np.empty(0)
    beams = np.flatnonzero(scan.ranges[::every] >= np.float32(scan.range_max))
    return ends(scan, beams * every, np.full(len(beams), float(free)))
