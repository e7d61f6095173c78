"""Options of the robot's world: validation, and the floor, markers and starts they select."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, cast

from minerva_agents.robot.deciding import PLANNERS
from minerva_agents.robot.grids import MapError, Mask
from minerva_agents.robot.ground import room_of
from minerva_agents.robot.maps import load_map
from minerva_agents.robot.occupancy import MapPose, Marker, OccupancyMap
from minerva_agents.robot.placing import free_component, roomiest, spread
from minerva_bus import portable
from minerva_bus.errors import WorldFileError, nearest

_OFFICE: Final = Path(__file__).parent / "plan" / "office.yaml"
_FAVOURITE: Final = "kitchen"
_MARKERS: Final = 6
_SPACING: Final = 3.0
"""Minimum distance between the centres of adjacent robots at the start, in radii."""
_LAST_FLOOR: Final[list[OccupancyMap]] = []


@dataclass(frozen=True)
class RobotOptions:
    """The options of the robot's world; the module `world` lists them."""

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
    def read(options: Mapping[str, Any]) -> RobotOptions:
        """Parse options and fill in defaults.

        Raises WorldFileError; ignores other members' options.
        """
        raw = _RawOptions(options)
        raw.check_from_zero("speed")
        return RobotOptions(
            raw.text("map", ""),
            raw.places("markers"),
            raw.text("start", ""),
            raw.count("robots", 1),
            raw.one_of("planner", list(PLANNERS)),
            raw.text("parcels", "*"),
            raw.text("objective", ""),
            raw.length("cell", 0.1),
            raw.length("radius", 0.18),
            raw.length("fov", 60.0),
            raw.length("sight", 5.0),
            raw.one_of("localise", ["odometry", "matching"]),
        )

    @cached_property
    def floor(self) -> OccupancyMap:
        """The map, read once; the office plan by default."""
        return _read_floor(self.map or _OFFICE)

    @cached_property
    def start_pose(self) -> MapPose:
        """Start of the first robot: x, y (m) and degrees."""
        return self._start_given() or self.floor.start or roomiest(self.floor, self.radius)

    @cached_property
    def places(self) -> tuple[Marker, ...]:
        """The markers: from the options, the map, or spread over the floor."""
        return self.given_places or self._spread()

    @property
    def given_places(self) -> tuple[Marker, ...]:
        """The markers that the options or the map place; none if they are spread."""
        if self.markers:
            return tuple([self._marker(name, *at) for name, at in self.markers.items()])
        return self.floor.markers

    @cached_property
    def starts(self) -> tuple[MapPose, ...]:
        """Start poses, adjacent to the first robot's. Raises MapError."""
        x, y, angle = self.start_pose
        component = free_component(self.floor, self.radius, (x, y))
        chosen = [(x, y)]
        least = _SPACING * self.radius
        # Listing all free cells takes long, and a single robot needs none of them.
        others = self._clear_of_walls(component).nonzero() if self.robots > 1 else ()
        cells = [(int(row), int(column)) for row, column in zip(*others, strict=True)]
        free = [self.floor.centre_of(cell) for cell in cells]
        for place in sorted(free, key=lambda position: (portable.dist(position, (x, y)), position)):
            if len(chosen) == self.robots:
                break
            if all(portable.dist(place, other) >= least for other in chosen):
                chosen.append(place)
        if len(chosen) < self.robots:
            raise MapError(
                f"there is room for {len(chosen)} robots around ({x}, {y}) m, of {self.robots}"
                f" requested; use fewer, or a radius smaller than {self.radius} m"
            )
        return tuple([(*place, angle) for place in chosen])

    def _clear_of_walls(self, component: Mask) -> Mask:
        """Cells of the component where a robot touches no part of an obstacle cell."""
        return component & (self.floor.room > room_of(self.radius, self.floor.resolution))

    @cached_property
    def goal(self) -> str:
        """Name of the objective. Raises WorldFileError if no such marker exists."""
        if self.objective:
            return self._named("objective", self.objective).name
        names = [marker.name for marker in self.places]
        return _FAVOURITE if _FAVOURITE in names else self._farthest()

    @cached_property
    def parcel_places(self) -> tuple[Marker, ...]:
        """The marker of each parcel. Raises WorldFileError if no such marker exists."""
        if self.parcels.strip() == "*":
            return self.places
        names = [name.strip() for name in self.parcels.split(",")]
        return tuple([self._named("parcels", name) for name in names if name])

    def _named(self, option: str, name: str) -> Marker:
        markers = {marker.name: marker for marker in self.places}
        if name not in markers:
            hint = nearest(name, list(markers), f"available: {', '.join(markers)}")
            raise WorldFileError(f"option {option}: unknown marker {name!r}{hint}")
        return markers[name]

    def _farthest(self) -> str:
        start = self.start_pose[:2]
        return max(self.places, key=lambda marker: portable.dist((marker.x, marker.y), start)).name

    def _start_given(self) -> MapPose | None:
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
                f"option markers: {name} at ({x}, {y}) m is not on the map; expected metres in the"
                " map's world frame"
            )
        return Marker(name, x, y)

    def _spread(self) -> tuple[Marker, ...]:
        """Up to six markers, as many as fit."""
        return spread(self.floor, _MARKERS, self.radius, self.start_pose, least=1)


def _read_floor(path: str | Path) -> OccupancyMap:
    """The map in a file; an equal map that was read last is returned as the same object.

    Defaults and scene of a world use one map, and the object caches computations that take far
    longer than reading the file.
    """
    floor = load_map(path)
    if not (_LAST_FLOOR and _LAST_FLOOR[0].equals(floor)):
        _LAST_FLOOR[:] = [floor]
    return _LAST_FLOOR[0]


@dataclass(frozen=True, slots=True)
class _RawOptions:
    """Raw option values with one checked accessor per type."""

    values: Mapping[str, Any]

    def text(self, name: str, default: str) -> str:
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise _wrong(name, value, "a string")
        return value

    def count(self, name: str, default: int) -> int:
        value = self.values.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise _wrong(name, value, "an integer >= 1")
        return value

    def length(self, name: str, default: float) -> float:
        number = _number(self.values.get(name, default))
        if number is None or number <= 0:
            raise _wrong(name, self.values[name], "a number above 0")
        return number

    def check_from_zero(self, name: str) -> None:
        """Check an option of another member, where present: a number >= 0."""
        number = _number(self.values.get(name, 0.0))
        if number is None or number < 0:
            raise _wrong(name, self.values[name], "a number >= 0")

    def one_of(self, name: str, choices: list[str]) -> str:
        value = self.text(name, choices[0])
        if value not in choices:
            expected = " or ".join(map(repr, choices))
            raise _wrong(name, value, f"{expected}{nearest(value, choices)}")
        return value

    def places(self, name: str) -> Mapping[str, tuple[float, float]]:
        value: object = self.values.get(name, {})
        if not isinstance(value, Mapping):
            raise _wrong(name, value, "names with positions, {kitchen = [x, y]}")
        entries = cast("Mapping[object, object]", value)
        return {str(marker): _place(f"{name}.{marker}", at) for marker, at in entries.items()}


def _place(name: str, value: object) -> tuple[float, float]:
    items = cast("list[object]", value if isinstance(value, list | tuple) else [])
    numbers = [number for item in items if (number := _number(item)) is not None]
    if not len(numbers) == len(items) == 2:
        raise _wrong(name, cast("object", value), "a position [x, y] in metres")
    return numbers[0], numbers[1]


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def _wrong(name: str, value: object, expected: str) -> WorldFileError:
    shown = repr(value) if len(repr(value)) <= 60 else repr(value)[:57] + "..."
    return WorldFileError(f"option {name}: expected {expected}, not {shown}")
