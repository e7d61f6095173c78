"""The robot's world: its vocabulary, and the initial string (4.2.4) from options.

| option    | default    | meaning                                                               |
  |-----------|------------|-----------------------------------------------------------------------|
  | map       | ""         | map_server map, .yaml or an image; "": the office plan                |
  | markers   | {}         | positions by name, {kitchen = [x, y]}; {}: the map's, or up to six    |
  | start     | ""         | "x, y, degrees"; "": the map's, or where clearance is largest         |
  | robots    | 1          | number of robots; they start side by side                             |
  | planner   | "astar"    | decision algorithm: "astar", "random" or "module:function"            |
  | parcels   | "*"        | one at each of these markers, "office, store"; "*": at every marker   |
  | objective | ""         | a marker; "": the kitchen, otherwise the farthest from the start      |
  | cell      | 0.1        | side of a cell of the robots' grid, metres                            |
  | radius    | 0.18       | radius of a robot, metres                                             |
  | fov       | 60         | field of view of the camera, degrees                                  |
  | sight     | 5.0        | range at which the camera recognises a marker, metres                 |
  | localise  | "odometry" | "matching": correct odometry by scans, see `robot.ALocalisingRobot`   |
  | physics   | "physics"  | "bodies": solids in space, by the extension of this name              |

All other options belong to the world's other members.

With "astar" a robot passes every door of at least `passable_width`, 0.5 m for the defaults, in a
wall along the lines of its grid. It passes narrower ones, and those in oblique walls, only where
its grid lines fall favourably. The grid makes walls thicker than they are, by up to one cell on
each side of an opening and by more in oblique walls. So `notes` asks the robot's own planner before
the start, instead of estimating from a width.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot import vocabulary as words
from minerva_agents.robot.approach import NEAR, cells_with_view
from minerva_agents.robot.clearance import Narrows, blocked, passable_width, room_of
from minerva_agents.robot.control import PLANNERS
from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.grid import FREE, SURE, MapError, Mask, grown, holds, obstacles
from minerva_agents.robot.maps import (
    OCCUPIED,
    MapPose,
    Marker,
    OccupancyMap,
    free_component,
    load_map,
    regions,
    roomiest,
    spread,
)
from minerva_agents.robot.own_planner import own_planner
from minerva_agents.robot.pose import Cell, Position, Reals, cell_of
from minerva_agents.robot.robot import ALocalisingRobot, ARobot
from minerva_agents.robot.vocabulary import PMap, PMarker, TPlace
from minerva_bus import Cells, Scene, Vocabulary, portable
from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.grammar.scene import MATRIX_CELLS
from minerva_bus.values import fast_dataclass

# --- options --------------------------------------------------------------------------------------


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
            raw.planner(),
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


@fast_dataclass
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

    def planner(self) -> str:
        value = self.text("planner", "")
        if ":" not in value:
            return self.one_of("planner", list(PLANNERS))
        own_planner(value)  # An error here names the world file.
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


vocabulary: Final = Vocabulary.of(
    words.PMap,
    words.PMarker,
    words.PRobot,
    words.PGrid,
    words.PPath,
    words.PObjective,
    words.PGoal,
    words.PParcel,
    words.TMove,
    words.TRotate,
    words.TPlace,
    words.eLaser,
    words.eClear,
    words.eCamera,
    words.eDecide,
    words.eObjective,
    words.eSpeed,
    words.eCollision,
    words.eReached,
    words.eUnreachable,
    words.eRefused,
    words.eErrand,
    words.eTake,
    words.eTaken,
    words.eCarry,
    words.ePut,
    words.eDelivered,
    words.eGivenUp,
    words.eInterrupt,
    words.eInterrupted,
    words.eRepresent,
    words.ePicture,
    ARobot,
    ALocalisingRobot,
    AParcel,
)
"""All symbols and event types of the robot's world."""

_NAMES: Final = (
    "map",
    "start",
    "robots",
    "planner",
    "parcels",
    "cell",
    "radius",
    "fov",
    "sight",
    "localise",
)

_SERVICES: Final = {"bodies": "rovers"}
"""Services by the option `physics`, where their names differ."""

_PARCEL_DIRECTION: Final = -90.0
"""Direction of the parcels at a marker in degrees; the world's y is up."""
_PARCEL_FAN: Final = 140.0
"""Angle between the outermost parcels in degrees."""
_DOOR_WIDTH: Final = 0.7
"""Width in metres of a narrow but common door."""
_SURFACE: Final = 2e-3
"""Depth in metres up to which a marker counts as on the surface of an obstacle."""

_USUAL_CELL: Final = 0.1
"""Metres; the default of the option `cell`, and recommended where much larger cells are chosen."""
_CELL_DIVISORS: Final = (2, 4, 8)
_GOLDEN_RATIO: Final = (math.sqrt(5.0) - 1.0) / 2.0


def scene(options: Mapping[str, Any]) -> Scene:
    """The initial string: PMap, the markers, robots r1, r2, ... and parcels p1, p2, ...

    The robots have no objective yet. Parcels come last, so that pictures draw them on top. Raises
    MinervaError for invalid options and maps.
    """
    chosen = RobotOptions.read(options)
    floor = chosen.floor
    string = PMap(floor.cells, floor.resolution, floor.x, floor.y, floor.angle)
    for marker in chosen.places:
        string += TPlace(marker.x, marker.y)(PMarker(marker.name))
    grid = _empty_grid(floor, chosen.cell)
    for number, start in enumerate(chosen.starts, start=1):
        string += _robot(f"r{number}", start, grid, chosen).string
    for number, marker in enumerate(chosen.parcel_places, start=1):
        string += _parcel(number, marker).string
    return string


def defaults(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """The validated options with defaults and the objective filled in.

    Raises MinervaError for invalid options and maps.
    """
    chosen = RobotOptions.read(options)
    values = {name: getattr(chosen, name) for name in _NAMES if name not in options}
    physics = options.get("physics", "physics")
    service = _SERVICES.get(physics, physics)
    return {**values, **options, "objective": chosen.goal, "physics": service}


def notes(options: Mapping[str, Any]) -> Sequence[str]:
    """Hints about doors that are too narrow for the cells, and markers that no camera sees."""
    chosen = RobotOptions.read(options)
    return (*_doors(chosen), *_shut_off(chosen), *_hidden(chosen))


def _doors(chosen: RobotOptions) -> Sequence[str]:
    """A hint if robots cannot pass doors of common width, with a cell size that would help."""
    limit = passable_width(chosen.radius, chosen.cell)
    sizes = [*(round(chosen.cell / part, 9) for part in _CELL_DIVISORS), _USUAL_CELL]
    better = [size for size in sizes if passable_width(chosen.radius, size) <= _DOOR_WIDTH]
    if limit <= _DOOR_WIDTH or not better:
        return ()
    return (
        f"the robots pass doors of at least {limit:.2f} m, because their cells are"
        f" {chosen.cell:g} m wide; with --cell {better[0]:g} the limit is"
        f" {passable_width(chosen.radius, better[0]):.2f} m",
    )


def _shut_off(chosen: RobotOptions) -> Sequence[str]:
    """A hint if robots find no way to markers because of their cells, and one with smaller ones."""
    names = _out_of_reach(chosen, chosen.cell)
    if not names:
        return ()
    for part in _CELL_DIVISORS:
        size = round(chosen.cell / part, 9)
        helped = names - _out_of_reach(chosen, size)
        if helped:
            return (
                f"the robots may find no way to {', '.join(sorted(helped))}: with cells of"
                f" {chosen.cell:g} m an opening on the way looks narrower than it is; use"
                f" --cell {size:g}",
            )
    return ()


def _out_of_reach(chosen: RobotOptions, cell: float) -> set[str]:
    """Names of the markers to which robots find no way, although they know the map."""
    try:
        empty = _empty_grid(chosen.floor, cell)
    except MapError:  # too many cells, so nobody can use this size
        return {marker.name for marker in chosen.places}
    grid = known_grid(chosen.floor, empty.cells, empty.x, empty.y, cell)
    at = empty.position(*chosen.start_pose[:2], cell)
    places = {
        marker.name: cell_of(empty.position(marker.x, marker.y, cell))
        for marker in chosen.places
        if not _is_inside(marker, chosen.floor)
    }
    # Most floors have no narrow opening, and the fine grid takes several times as long.
    for fine in (False, True) if chosen.planner == "astar" else (False,):
        reachable = reachable_cells(grid, at, chosen.radius, cell, fine=fine)
        places = {
            name: place
            for name, place in places.items()
            if not is_within_reach(reachable, grid, place, cell)
        }
        if not places:
            break
    return set(places)


def _hidden(chosen: RobotOptions) -> Sequence[str]:
    """A hint if there are markers inside obstacles."""
    names = [marker.name for marker in chosen.given_places if _is_inside(marker, chosen.floor)]
    if not names:
        return ()
    return (
        f"no robot can find {', '.join(names)}: the map has an obstacle there, which hides the"
        " marker from cameras; move it to a free cell",
    )


def _is_inside(marker: Marker, floor: OccupancyMap) -> bool:
    """Whether a marker is deeper in an obstacle than on its surface, where cameras see it."""
    cells = [
        floor.cell_at(marker.x + down, marker.y + across)
        for down in (-_SURFACE, _SURFACE)
        for across in (-_SURFACE, _SURFACE)
    ]
    return all(holds(floor.cells, cell) and floor.cells[cell] == OCCUPIED for cell in cells)


def _robot(name: str, start: MapPose, grid: _Grid, chosen: RobotOptions) -> ARobot:
    """A robot without knowledge, objective or action (4.2.4)."""
    angle = start[2]
    row, column = grid.position(*start[:2], chosen.cell)
    kind = ALocalisingRobot if chosen.localise == "matching" else ARobot
    return kind(
        name,
        grid=grid.cells,
        row=row,
        column=column,
        angle=angle,
        cell=chosen.cell,
        x0=grid.x,
        y0=grid.y,
        radius=chosen.radius,
        planner=chosen.planner,
        markers=tuple([marker.name for marker in chosen.places]),
        fov=chosen.fov,
        sight=chosen.sight,
    )


def _parcel(number: int, marker: Marker) -> AParcel:
    """A parcel at a marker, in a direction of its own: golden-ratio steps never repeat.

    All directions point below the marker, because pictures show its pin and name above.
    """
    part = (0.5 + _GOLDEN_RATIO * (number - 1)) % 1.0
    side = round(_PARCEL_DIRECTION + _PARCEL_FAN * (part - 0.5), 3)
    parcel = AParcel(f"p{number}", x=marker.x, y=marker.y, side=side)
    parcel.stand(marker.name, marker.x, marker.y)
    return parcel


@fast_dataclass
class _Grid:
    """Empty cells, and the world position of the outer corner of cell (0, 0)."""

    cells: Cells
    x: float
    y: float

    def position(self, x: float, y: float, cell: float) -> Position:
        """Position in cells, with the side `cell`, of a place in metres."""
        return (x - self.x) / cell, (y - self.y) / cell


def _empty_grid(floor: OccupancyMap, cell: float) -> _Grid:
    """A grid under the whole map plus one cell on each side. Raises MapError if too large."""
    rows, columns = floor.cells.shape
    ends = [floor.corner_of((row, column)) for row in (0, rows) for column in (0, columns)]
    x, y = (min(end[axis] for end in ends) for axis in (0, 1))
    far_x, far_y = (max(end[axis] for end in ends) for axis in (0, 1))
    sides = far_x - x, far_y - y
    # `not <=`, so that nan is rejected, too.
    if not math.prod(side / cell + 3 for side in sides) <= MATRIX_CELLS:
        raise MapError(
            f"a map of {sides[0]:g} m x {sides[1]:g} m needs more than {MATRIX_CELLS} cells of"
            f" {cell:g} m, the limit of a grid; check the map's resolution, or use larger cells"
        )
    # Rounded first: the quotient may lie just above a whole number.
    high, wide = (math.ceil(round(side / cell, 6)) + 2 for side in sides)
    cells = np.zeros((high, wide), np.int16)
    # Shared by all robots; `writable` copies it at the first change.
    cells.setflags(write=False)
    return _Grid(cells, round(x - cell, 9), round(y - cell, 9))


# --- what a robot will know, and where it can get -------------------------------------------------


_INSIDE = 1e-6
"""Depth of a hit in an obstacle, in cells of the map; it decides between two cells of the grid."""


def known_grid(floor: OccupancyMap, empty: Cells, x: float, y: float, cell: float) -> Cells:
    """A robot's grid once a laser has seen every surface of the map.

    Args:
        floor: the map; everything outside it counts as an obstacle.
        empty: a grid without knowledge.
        x: of the outer corner of its cell (0, 0), in metres.
        y: likewise.
        cell: side of its cells in metres.

    """
    grid = np.full_like(empty, FREE)
    solid = np.pad(floor.obstacles, 1, constant_values=True)
    for rows, columns in _surfaces(solid, 1 + math.ceil(2.0 * floor.resolution / cell)):
        xs, ys = floor.point(rows - 1.0, columns - 1.0)
        grid[_lines(xs - x, cell, grid.shape[0]), _lines(ys - y, cell, grid.shape[1])] = SURE
    return grid


def _surfaces(solid: Mask, count: int) -> Iterator[tuple[Reals, Reals]]:
    """Rows and columns of `count` points on each side that an obstacle shares with a free cell."""
    along = np.linspace(_INSIDE, 1.0 - _INSIDE, count)
    for walls, is_turned in ((solid, False), (solid.T, True)):
        for step, depth in ((1, 1.0 - _INSIDE), (-1, _INSIDE)):
            # `roll` wraps around only from border to border, and both are solid.
            across, beside = np.nonzero(walls & ~np.roll(walls, -step, axis=0))
            first = np.repeat(across.astype(np.float64) + depth, count)
            second: Reals = np.add.outer(beside, along).ravel()
            yield (second, first) if is_turned else (first, second)


def _lines(metres: Reals, cell: float, count: int) -> NDArray[np.intp]:
    """Rows or columns of the grid at these distances from its first."""
    return np.floor(metres / cell).astype(np.intp).clip(0, count - 1)


def is_within_reach(reachable: Mask, grid: Cells, place: Cell, cell: float) -> bool:
    """True if a robot gets as near to a marker, in view of it, as arrival demands."""
    walls = obstacles(grid)
    # A robot that gets to the marker itself needs no line to it; most do.
    is_reached = holds(grid, place) and reachable[place] and not walls[place]
    return bool(is_reached or (reachable & cells_with_view(walls, place, NEAR / cell)).any())


def reachable_cells(grid: Cells, at: Position, radius: float, cell: float, fine: bool) -> Mask:
    """Cells to which a robot at `at`, in cells, finds a way; `fine`: also through narrow openings.

    `radius` and `cell` are in metres.
    """
    if not fine:
        labels = regions(~blocked(grid, at, room_of(radius, cell)))
        return labels == labels[cell_of(at)]
    narrows = Narrows.around(grid, at, radius, cell)
    labels = regions(~narrows.closed)
    return grown(labels == labels[cell_of(narrows.at)])[1::2, 1::2]
