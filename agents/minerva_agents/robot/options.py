"""The options of the robot's world, checked, and what they choose: a floor, markers, starts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, cast

from minerva_agents.robot.deciding import PLANNERS
from minerva_agents.robot.grids import MapError
from minerva_agents.robot.maps import load_map
from minerva_agents.robot.occupancy import Marker, OccupancyMap, Pose
from minerva_agents.robot.placing import free_component, roomiest, spread
from minerva_bus import portable
from minerva_bus.errors import WorldFileError, nearest

_OFFICE: Final = Path(__file__).parent / "plan" / "office.yaml"
_FAVOURITE: Final = "kitchen"
_MARKERS: Final = 6
_APART: Final = 3.0
"""Radii between the centres of robots that start side by side, at least."""
_LAST_FLOOR: Final[list[OccupancyMap]] = []


@dataclass(frozen=True)
class Options:
    """What a world file says of the robot's world; the table stands in `world`."""

    map: str = ""
    markers: Mapping[str, tuple[float, float]] | None = None
    start: str = ""
    robots: int = 1
    planner: str = "astar"
    parcels: str = "*"
    objective: str = ""
    cell: float = 0.1
    radius: float = 0.18
    fov: float = 60.0
    sight: float = 5.0
    localise: str = "odometry"

    @staticmethod
    def read(options: Mapping[str, Any]) -> Options:
        """The options with their defaults. Raises WorldFileError; passes over others' options."""
        given = _Given(options)
        given.check_from_zero("speed")
        return Options(
            given.text("map", ""),
            given.places("markers"),
            given.text("start", ""),
            given.count("robots", 1),
            given.one_of("planner", list(PLANNERS)),
            given.text("parcels", "*"),
            given.text("objective", ""),
            given.length("cell", 0.1),
            given.length("radius", 0.18),
            given.length("fov", 60.0),
            given.length("sight", 5.0),
            given.one_of("localise", ["odometry", "matching"]),
        )

    @cached_property
    def floor(self) -> OccupancyMap:
        """The map, with the markers that the options give or else its own or some."""
        return _read_floor(self.map or _OFFICE)

    @cached_property
    def start_pose(self) -> Pose:
        """Where the first robot starts: x, y and degrees."""
        return self._start_given() or self.floor.start or roomiest(self.floor, self.radius)

    @cached_property
    def places(self) -> tuple[Marker, ...]:
        """The markers."""
        if self.markers:
            return tuple([self._marker(name, *at) for name, at in self.markers.items()])
        return self.floor.markers or self._spread()

    @cached_property
    def starts(self) -> tuple[Pose, ...]:
        """Where the robots start: side by side, the first at the start. Raises MapError."""
        x, y, angle = self.start_pose
        component = free_component(self.floor, self.radius, (x, y))
        chosen = [(x, y)]
        least = _APART * self.radius
        others = component.nonzero() if self.robots > 1 else ()
        cells = [(int(row), int(column)) for row, column in zip(*others, strict=True)]
        free = [self.floor.centre_of(cell) for cell in cells]
        for place in sorted(free, key=lambda one: (portable.dist(one, (x, y)), one)):
            if len(chosen) == self.robots:
                break
            if all(portable.dist(place, other) >= least for other in chosen):
                chosen.append(place)
        if len(chosen) < self.robots:
            raise MapError(
                f"there is room for {len(chosen)} robots around ({x}, {y}) m, of the {self.robots}"
                f" asked for; ask for fewer, or take a radius smaller than {self.radius} m"
            )
        return tuple([(*place, angle) for place in chosen])

    @cached_property
    def goal(self) -> str:
        """The objective's name. Raises WorldFileError where there is no such marker."""
        if self.objective:
            return self._named("objective", self.objective).name
        names = [marker.name for marker in self.places]
        return _FAVOURITE if _FAVOURITE in names else self._farthest()

    @cached_property
    def parcel_places(self) -> tuple[Marker, ...]:
        """The marker of each parcel. Raises WorldFileError where there is no such marker."""
        if self.parcels.strip() == "*":
            return self.places
        names = [name.strip() for name in self.parcels.split(",")]
        return tuple([self._named("parcels", name) for name in names if name])

    def _named(self, option: str, name: str) -> Marker:
        found = {marker.name: marker for marker in self.places}
        if name not in found:
            raise WorldFileError(
                f"option {option}: there is no marker {name!r}"
                f"{nearest(name, list(found))}; there are {', '.join(found)}"
            )
        return found[name]

    def _farthest(self) -> str:
        start = self.start_pose[:2]
        return max(self.places, key=lambda one: portable.dist((one.x, one.y), start)).name

    def _start_given(self) -> Pose | None:
        if not self.start:
            return None
        try:
            numbers = [float(part) for part in self.start.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
            raise WorldFileError(f"option start: expected 'x, y, degrees', not {self.start!r}")
        x, y, angle = (*numbers, 0.0)[:3]
        return x, y, angle

    def _marker(self, name: str, x: float, y: float) -> Marker:
        if not self.floor.holds(x, y):
            raise WorldFileError(
                f"option markers: {name} at ({x}, {y}) m is not on the map; expected metres of the"
                " map's own world"
            )
        return Marker(name, x, y)

    def _spread(self) -> tuple[Marker, ...]:
        """As many markers as there is room for, at most six."""
        return spread(self.floor, _MARKERS, self.radius, self.start_pose, least=1)


def _read_floor(path: str | Path) -> OccupancyMap:
    """The map in a file; the object that was read last where both are the same.

    A world's defaults and its scene are made of one map, and the object keeps what was computed of
    it, which takes far longer than reading it.
    """
    floor = load_map(path)
    if not (_LAST_FLOOR and _LAST_FLOOR[0].equals(floor)):
        _LAST_FLOOR[:] = [floor]
    return _LAST_FLOOR[0]


@dataclass(frozen=True, slots=True)
class _Given:
    """Options as they are written, with a check for each kind of value."""

    values: Mapping[str, Any]

    def text(self, name: str, default: str) -> str:
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise _wrong(name, value, "a text")
        return value

    def count(self, name: str, default: int) -> int:
        value = self.values.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise _wrong(name, value, "a whole number from 1 up")
        return value

    def length(self, name: str, default: float) -> float:
        number = _number(self.values.get(name, default))
        if number is None or number <= 0:
            raise _wrong(name, self.values[name], "a number above 0")
        return number

    def check_from_zero(self, name: str) -> None:
        """Whether an option of another process, where it is given, is a number from 0 up."""
        number = _number(self.values.get(name, 0.0))
        if number is None or number < 0:
            raise _wrong(name, self.values[name], "a number from 0 up")

    def one_of(self, name: str, choices: list[str]) -> str:
        value = self.text(name, choices[0])
        if value not in choices:
            listed = " or ".join(map(repr, choices))
            raise _wrong(name, value, f"{listed}{nearest(value, choices)}")
        return value

    def places(self, name: str) -> Mapping[str, tuple[float, float]]:
        value: object = self.values.get(name, {})
        if not isinstance(value, Mapping):
            raise _wrong(name, value, "names with places, {kitchen = [x, y]}")
        found = cast("Mapping[object, object]", value)
        return {str(marker): _place(f"{name}.{marker}", at) for marker, at in found.items()}


def _place(name: str, value: object) -> tuple[float, float]:
    items = cast("list[object]", value if isinstance(value, list | tuple) else [])
    numbers = [number for item in items if (number := _number(item)) is not None]
    if not len(numbers) == len(items) == 2:
        raise _wrong(name, cast("object", value), "a place [x, y] in metres")
    return numbers[0], numbers[1]


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def _wrong(name: str, value: object, expected: str) -> WorldFileError:
    shown = repr(value) if len(repr(value)) <= 60 else repr(value)[:57] + "..."
    return WorldFileError(f"option {name}: expected {expected}, not {shown}")
