"""The robot's world: its vocabulary, and the initial string (4.2.4) from options.

| option    | default    | meaning                                                               |
  |-----------|------------|-----------------------------------------------------------------------|
  | map       | ""         | map_server map, .yaml or an image; "": the office plan                |
  | markers   | {}         | positions by name, {kitchen = [x, y]}; {}: the map's, or up to six    |
  | start     | ""         | "x, y, degrees"; "": the map's, or where clearance is largest         |
  | robots    | 1          | number of robots; they start side by side                             |
  | planner   | "astar"    | decision algorithm, "astar" or "random"                               |
  | parcels   | "*"        | one at each of these markers, "office, store"; "*": at every marker   |
  | objective | ""         | a marker; "": the kitchen, otherwise the farthest from the start      |
  | cell      | 0.1        | side of a cell of the robots' grid, metres                            |
  | radius    | 0.18       | radius of a robot, metres                                             |
  | fov       | 60         | field of view of the camera, degrees                                  |
  | sight     | 5.0        | range at which the camera recognises a marker, metres                 |
  | localise  | "odometry" | "matching": correct odometry by scans, see `localising`               |

All other options belong to the world's other members.

With "astar" a robot passes every door of at least `narrows.passable_width`, 0.5 m for the defaults,
in a wall along the lines of its grid. It passes narrower ones, and those in oblique walls, only
where its grid lines fall favourably; `notes` computes that from the map.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from minerva_agents.robot import vocabulary as words
from minerva_agents.robot.foreseen import is_within_reach, known_grid, reachable_cells
from minerva_agents.robot.grids import MapError
from minerva_agents.robot.knowledge import holds
from minerva_agents.robot.localising import ALocalisingRobot
from minerva_agents.robot.motion import Position, cell_of
from minerva_agents.robot.narrows import passable_width
from minerva_agents.robot.occupancy import OCCUPIED, MapPose, Marker, OccupancyMap
from minerva_agents.robot.options import RobotOptions
from minerva_agents.robot.parcel import AParcel
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.vocabulary import PMap, PMarker, TPlace
from minerva_bus import Cells, Scene, Vocabulary
from minerva_bus.grammar.literals import MATRIX_CELLS

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
    return {**values, **options, "objective": chosen.goal}


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


@dataclass(frozen=True, slots=True)
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
