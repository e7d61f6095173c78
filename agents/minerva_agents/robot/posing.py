"""Where the robot was when it measured each scan of a recording."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from minerva_bus.world.poses import interpolated, moved
from minerva_bus.world.readings import Odometry, Scan
from minerva_bus.world.recordings import CORRECTION, POSE, Recorded

NEAR: Final = 1.0
"""Seconds from a scan to the next thing known of the robot's place, at most."""

_WAITING: Final = 10_000
"""Scans that wait for odometry, at most; the oldest are left out."""


@dataclass(frozen=True, slots=True)
class Posed:
    """A scan, and where the robot was: metres and degrees counter-clockwise.

    `told`: the recording says so of this very scan.
    """

    scan: Scan
    x: float
    y: float
    angle: float
    told: bool = False


@dataclass(frozen=True, slots=True)
class Unposed:
    """A scan of which nobody knows where it was measured."""

    scan: Scan


def posed_scans(
    recorded: Iterable[Recorded], *, odometry: bool = False
) -> Iterator[Posed | Unposed]:
    """The scans in their order, each with its place.

    That is what the recording says of this very scan on the topic `pose`; else, or if nothing but
    `odometry` shall count, the odometry: of the time of the scan, or between the reading before
    and the one after.
    """
    posing, wheels = _Posing(), _Wheels()
    for one in recorded:
        if isinstance(one.reading, Scan):
            yield from posing.measured(one.reading)
        elif not isinstance(one.reading, Odometry):
            continue
        elif one.topic == POSE:
            posing.told = None if odometry else one.reading
        elif one.topic == CORRECTION:
            wheels.corrected(one.reading)
        else:
            measured = wheels.measured(one.reading) if odometry else one.reading
            yield from posing.moved(measured)
    yield from posing.rest()


class _Posing:
    """What is known of the robot's place, and the scans that wait for more."""

    def __init__(self) -> None:
        self.told: Odometry | None = None
        self._before: Odometry | None = None
        self._waiting: deque[Scan] = deque()

    def measured(self, scan: Scan) -> Iterator[Posed | Unposed]:
        told, self.told = self.told, None
        if told is not None:
            yield from self.rest()
            yield Posed(scan, told.x, told.y, told.angle, told=True)
            return
        if self._before is not None and self._before.time == scan.time:
            yield from self.rest()
            yield _between(scan, self._before, None)
            return
        self._waiting.append(scan)
        if len(self._waiting) > _WAITING:
            yield Unposed(self._waiting.popleft())

    def moved(self, after: Odometry) -> Iterator[Posed | Unposed]:
        while self._waiting and not self._waiting[0].time > after.time:
            yield _between(self._waiting.popleft(), self._before, after)
        self._before = after

    def rest(self) -> Iterator[Posed | Unposed]:
        """What waits for odometry that does not come."""
        while self._waiting:
            yield _between(self._waiting.popleft(), self._before, None)


class _Wheels:
    """What the wheels have measured, where a recording has moved it by corrections."""

    def __init__(self) -> None:
        self._last: Odometry | None = None
        self._start: tuple[Odometry, Odometry] | None = None

    def corrected(self, to: Odometry) -> None:
        """From here on the odometry says that the robot was there."""
        if self._last is not None:
            self._start = self._last, to

    def measured(self, said: Odometry) -> Odometry:
        """Where the wheels alone would have the robot."""
        if self._start is not None:
            start, correction = self._start
            at = moved(start, correction, said)
            said = replace(said, x=at.x, y=at.y, angle=at.angle)
        self._last = said
        return said


_Known: TypeAlias = "Odometry | None"


def _between(scan: Scan, before: _Known, after: _Known) -> Posed | Unposed:
    """A scan at its place between two readings, or at the one that is near enough."""
    near = [known for known in (before, after) if known and abs(known.time - scan.time) <= NEAR]
    if not near:
        return Unposed(scan)
    first, last = near[0], near[-1]
    span = last.time - first.time
    part = min(1.0, max(0.0, (scan.time - first.time) / span)) if span > 0 else 1.0
    pose = interpolated(first, last, part)
    return Posed(scan, pose.x, pose.y, pose.angle)
