"""Vehicles on the roads of a SUMO network, which follow each other by the model of Krauß.

A second takes two frames: in the first one the vehicles show where they are, in the second one
`Roads` tells each what is ahead, and they move. Units are metres, seconds and metres per second.

Stefan Krauß (1998): Microscopic modeling of traffic flow: investigation of collision free vehicle
dynamics. Dissertation, Universität zu Köln.
"""

# sumolib has no types of its own.
# pyright: basic

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from minerva_bus import (
    Agent,
    Device,
    Event,
    EventType,
    Generator,
    Primitive,
    Scene,
    Tick,
    View,
    World,
    on,
    service,
    view,
)
from minerva_bus.grammar.ids import Ids
from minerva_services.physics.neighbours.spots import Names, SpotReader, Spots

FAR = 1e6
SIGHT, LINE = 100.0, 1.0
"""How far a vehicle looks ahead, and the distance from a junction at which it waits."""

CARE, GAIN = 1.0, 2.6
"""Seconds between two vehicles in a junction, and the acceleration that is expected there."""

STEP = 2
"""Frames of a second."""

PVehicle = Primitive("PVehicle", who=str, x=float, speed=float, goal=float)
eWhere = EventType("eWhere", visual=True)
NUMBERS = ("gap", "ahead", "limit", "bend", "slow", "line", "again", "beyond")
eDrive = EventType("eDrive", time=float, **dict.fromkeys(NUMBERS, float))


class Vehicle(Agent, symbol="AVehicle"):
    """Is `x` along its way, and leaves the road at its goal."""

    x: float
    speed: float
    goal: float
    departs: float
    arrives: float = 0.0
    length: float = 5.0
    space: float = 2.5  # to the vehicle ahead at rest
    acceleration: float = 2.6
    braking: float = 4.5
    dawdling: float = 0.5
    wish: float = 1.0  # its speed where it is free, as a part of the speed limit
    fastest: float = 200.0

    @on("eDrive", population=True)
    def drive(self, drive: Event, moment: Any) -> None:
        """Move for a second."""
        gap = drive.gap - self.space
        safe = stopping(gap + braked(drive.ahead, self.braking), self.braking)
        slow = drive.slow * self.wish
        safe = np.minimum(safe, slowing(drive.bend, slow, self.braking))
        # A vehicle that cannot stop before the line any more drives on.
        stops = drive.line > braked(self.speed, self.braking)
        halt = stopping(drive.line, self.braking)
        safe = np.where(stops, np.minimum(safe, halt), safe)
        free = np.minimum(drive.limit * self.wish, self.fastest)
        most = np.minimum(np.minimum(self.speed + self.acceleration, free), safe)
        least = np.minimum(np.maximum(self.speed - self.braking, 0.0), most)
        lost = self.dawdling * np.minimum(most, self.acceleration) * moment.chance.random()
        self.speed = np.maximum(np.maximum(most - lost, least), 0.0)
        passes = (self.x < drive.again) & (drive.again <= self.x + self.speed)
        self.x = self.x + self.speed
        self.goal = np.where(passes, drive.beyond, self.goal)
        self.arrives = np.where(self.x >= self.goal, drive.time + 1, self.arrives)

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return PVehicle(self.id, self.x, self.speed, self.goal)


def braked(speed: Any, braking: Any) -> Any:
    """Distance until a vehicle stands that brakes from the next second on."""
    seconds = np.floor(speed / braking)
    return seconds * speed - braking * seconds * (seconds + 1) / 2


def stopping(room: Any, braking: Any) -> Any:
    """Largest speed for the next second after which a vehicle can stop within the room.

    It drives for a second with it, its time of reaction, before it brakes.
    """
    room = np.maximum(room - 0.001, 0.0)
    seconds = np.floor(np.sqrt(0.25 + 2 * room / braking) - 0.5)
    full = braking * seconds * (seconds + 1) / 2
    return seconds * braking + (room - full) / (seconds + 1)


def slowing(distance: Any, slow: Any, braking: Any) -> Any:
    """Largest speed for the next second from which a vehicle is slow after a distance."""
    half = braking / 2 + slow
    seconds = np.floor((np.sqrt(half * half + 2 * braking * distance) - half) / braking)
    full = braking * seconds * (seconds + 1) / 2 + slow * (seconds + 1)
    return slow + seconds * braking + np.maximum(distance - full, 0.0) / (seconds + 1)


class Way(NamedTuple):
    """The lanes that a vehicle takes: where each begins on its way, and their speed limits.

    `goals`: where it gets a new goal while such are given, and this goal.
    """

    lanes: Sequence[str]
    starts: Any
    limits: Any
    goals: Sequence[tuple[float, float]] = ()


class Roads(
    Device, Generator, events=("eDrive",), draws=("eWhere",), coupled=True, when="each frame"
):
    """Tells each vehicle the distance to the next one, that one's speed, and the speed limit.

    Args:
        ways: the way of each vehicle, by its id.
        departs: when it is on the road.
        length: of all vehicles.
        yields: the lanes in a junction to which those who enter one have to give way.
        closes: the time from which on no vehicle gets a new goal.

    """

    def __init__(
        self,
        ways: Mapping[str, Way],
        yields: Mapping[str, Sequence[str]],
        departs: Mapping[str, float],
        length: float,
        closes: float,
    ) -> None:
        self.ways, self.yields, self.departs = ways, yields, departs
        self.length, self.closes = length, closes
        self.reader = SpotReader("roads", Names(y="speed"))
        self.vehicles: Spots | None = None

    def show(self, view: View) -> None:
        self.vehicles = self.reader.read(view.scene)

    def generate(self, tick: Tick) -> Iterator[Event]:
        if tick.number % STEP == 0 or self.vehicles is None:
            return
        time = tick.number // STEP
        shown = self.vehicles
        numbers = zip(shown.ids, shown.x, shown.y, shown.shown["goal"], strict=True)
        drivers = [
            Driver(who, self.ways[who], lane_at(self.ways[who], x), *map(float, (x, speed, goal)))
            for who, x, speed, goal in numbers
            if self.departs[who] <= time and x < goal
        ]
        if not drivers:
            return
        bodies = self._bodies(drivers)
        crossing = _crossing(drivers)
        rows = [
            (*self._ahead(driver, bodies), *self._limits(driver),
             driver.to_junction() - LINE if self._waits(driver, crossing) else FAR,
             *self._goal(driver, time)) for driver in drivers
        ]  # fmt: skip
        columns = dict(zip(NUMBERS, np.array(rows).T, strict=True))
        receivers = Ids.of([driver.who for driver in drivers])
        yield eDrive(time=float(time), **columns, receivers=receivers)

    def _bodies(self, drivers: Iterable[Driver]) -> Mapping[str, Sequence[tuple[float, ...]]]:
        """The fronts, backs and speeds of the vehicles on each lane."""
        bodies: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
        for driver in drivers:
            lane, back = driver.lane, driver.x - self.length
            while lane >= 0:
                start = driver.way.starts[lane]
                bodies[driver.way.lanes[lane]].append(
                    (driver.x - start, back - start, driver.speed)
                )
                lane = lane - 1 if back < start else -1
        return bodies

    def _ahead(
        self, driver: Driver, bodies: Mapping[str, Sequence[tuple[float, ...]]]
    ) -> tuple[float, float]:
        """Distance to the back of the next vehicle on a way, and its speed."""
        way, lane = driver.way, driver.lane
        while lane < len(way.lanes) and way.starts[lane] < min(driver.goal, driver.x + SIGHT):
            here = driver.x - way.starts[lane]
            others = [(back - here, speed) for front, back, speed in bodies[way.lanes[lane]]
                      if front > here]  # fmt: skip
            if others:
                return min(others)
            lane += 1
        return FAR, 0.0

    def _limits(self, driver: Driver) -> tuple[float, float, float]:
        """The speed limit, the distance to a lane where it is smaller, and that limit."""
        way, lane = driver.way, driver.lane
        limit = way.limits[lane]
        for other in range(lane + 1, min(lane + 4, len(way.lanes))):
            if way.limits[other] < limit:
                return limit, way.starts[other] - driver.x, way.limits[other]
        return limit, FAR, limit

    def _waits(self, driver: Driver, crossing: Mapping[str, Sequence[Driver]]) -> bool:
        """Whether a vehicle has to let another one pass, also if that one waits itself."""
        link = driver.link()
        if link is None or link <= driver.lane:
            return False
        lanes = self.yields.get(driver.way.lanes[link], ())
        return any(driver.meets(other, self.length) for lane in lanes for other in crossing[lane])

    def _goal(self, driver: Driver, time: int) -> tuple[float, float]:
        """Where a vehicle next gets a new goal, and this goal."""
        replaced = (pair for pair in driver.way.goals if driver.x < pair[0])
        return next(replaced, (FAR, 0.0)) if time + 1 < self.closes else (FAR, 0.0)


class Driver(NamedTuple):
    """A vehicle on its way, on the lane of this number."""

    who: str
    way: Way
    lane: int
    x: float
    speed: float
    goal: float

    def link(self) -> int | None:
        """The lane on which it enters the junction where it is, or the next one within sight."""
        lanes, lane = self.way.lanes, self.lane
        while lanes[lane][0] == ":" and lanes[lane - 1][0] == ":":
            lane -= 1
        while lane < len(lanes) and lanes[lane][0] != ":":
            lane += 1
        return lane if lane < len(lanes) and self.way.starts[lane] < self.x + SIGHT else None

    def to_junction(self) -> float:
        """Distance to the next junction; negative in a junction."""
        return self.way.starts[self.link() or 0] - self.x

    def meets(self, other: Driver, length: float) -> bool:
        """Whether two vehicles that need not wait would be in a junction at the same time."""
        arrives, leaves = self._crosses(length)
        first, last = other._crosses(length)
        return first < leaves + CARE and last > arrives - CARE

    def _crosses(self, length: float) -> tuple[float, float]:
        """Seconds until it enters the junction, and until it has left it."""
        way, link = self.way, self.link() or 0
        end = link
        while end < len(way.lanes) - 1 and way.lanes[end][0] == ":":
            end += 1
        first, last = way.starts[link] - self.x, way.starts[end] - self.x + length
        return self._reaches(first, way.limits[link]), self._reaches(last, way.limits[link])

    def _reaches(self, distance: float, limit: float) -> float:
        if distance <= 0:
            return 0.0
        quick = (math.sqrt(self.speed**2 + 2 * GAIN * distance) - self.speed) / GAIN
        return max(quick, distance / max(limit, self.speed))


def _crossing(drivers: Iterable[Driver]) -> Mapping[str, Sequence[Driver]]:
    """Who is in a junction or the next to enter it, by the lane on which this is.

    Those behind another one before the junction do not count: it may wait for those who wait for
    them.
    """
    crossing: dict[str, list[Driver]] = defaultdict(list)
    before: set[str] = set()
    for driver in sorted(drivers, key=lambda driver: driver.to_junction()):
        link = driver.link()
        if link is not None and (lane := driver.way.lanes[link - 1]) not in before:
            crossing[driver.way.lanes[link]].append(driver)
            if link > driver.lane:
                before.add(lane)
    return crossing


def lane_at(way: Way, x: float) -> int:
    """The number of the lane at a place of a way."""
    return int(np.searchsorted(way.starts, x, side="right")) - 1


def world(
    vehicles: Mapping[str, Any],
    ways: Mapping[str, Way],
    yields: Mapping[str, Sequence[str]],
    closes: float = 0.0,
) -> World:
    """The world of vehicles, given by columns with `ids` among them, that start on their ways."""
    columns = dict(vehicles)
    ids = columns.pop("ids")
    roads = service(
        Roads, ways=ways, yields=yields, departs=dict(zip(ids, columns["departs"], strict=True)),
        length=columns["length"], closes=closes,
    )  # fmt: skip
    return World(Vehicle.many(ids, **columns), services=[roads], name="vehicles")
