"""The robot's world: its vocabulary, and the initial string of 4.2.4 from a world file's options.

| option    | default   | meaning                                                               |
|-----------|-----------|-----------------------------------------------------------------------|
| map       | ""        | a map of the ROS map_server, .yaml, or an image; "": the office plan   |
| markers   | {}        | places by name, {kitchen = [x, y]}; {}: the map's own, or six far apart |
| start     | ""        | "x, y, degrees"; "": the map's own, or where there is most room        |
| robots    | 1         | how many; they start side by side                                     |
| planner   | "astar"   | how they decide, "astar" or "random"                                  |
| parcels   | "*"       | one at each of these markers, "office, store"; "*": at every one       |
| objective | ""        | a marker; "": the kitchen, or else the one farthest from the start     |
| cell      | 0.1       | metres, the side of a cell of the robots' grid                        |
| radius    | 0.18      | metres, a robot's                                                     |
| fov       | 60        | degrees, the width of the camera's field of view                      |
| sight     | 5.0       | metres, how far the camera recognises a marker                        |
| localise  | "odometry" | "matching": by their scans too, see `localising`                     |

Other options are left to the processes of the world.

With "astar" a robot passes every door from `narrows.passable_width` up, 0.5 m for the defaults. It
passes narrower ones only where the lines of its grid lie well in them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from minerva_agents.robot import vocabulary as words
from minerva_agents.robot.grids import MapError
from minerva_agents.robot.localising import ALocalisingRobot
from minerva_agents.robot.narrows import passable_width
from minerva_agents.robot.occupancy import Marker, OccupancyMap, Pose
from minerva_agents.robot.options import Options
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

_BELOW: Final = -90.0
"""The direction in which parcels stand at a marker, in degrees: the world's y is up."""
_BREADTH: Final = 140.0
"""Degrees between the outermost of them."""
_DOOR: Final = 0.7
"""Metres: hardly a door in a building is narrower."""
_PARTS_OF_CELLS: Final = (2, 4, 8)
_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0


def scene(options: Mapping[str, Any]) -> Scene:
    """The initial string: PMap, the markers, the robots r1, r2, ... and the parcels p1, p2, ...

    The robots have nothing in mind. The parcels come last, so pictures show them on top.
    Raises MinervaError for options and maps that cannot be used.
    """
    chosen = Options.read(options)
    floor = chosen.floor
    made = PMap(floor.cells, floor.resolution, floor.x, floor.y, floor.angle)
    for marker in chosen.places:
        made += TPlace(marker.x, marker.y)(PMarker(marker.name))
    grid = _empty_grid(floor, chosen.cell)
    for number, start in enumerate(chosen.starts, start=1):
        made += _robot(f"r{number}", start, grid, chosen).string
    for number, marker in enumerate(chosen.parcel_places, start=1):
        made += _parcel(number, marker).string
    return made


def defaults(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """The options with the objective filled in and all of them checked.

    Raises MinervaError for options and maps that cannot be used.
    """
    chosen = Options.read(options)
    made = {name: getattr(chosen, name) for name in _NAMES if name not in options}
    return {**made, **options, "objective": chosen.goal}


def notes(options: Mapping[str, Any]) -> Sequence[str]:
    """A line if the cells keep robots from doors of usual width, with a size that does not."""
    chosen = Options.read(options)
    limit = passable_width(chosen.radius, chosen.cell)
    sizes = [round(chosen.cell / part, 9) for part in _PARTS_OF_CELLS]
    better = [size for size in sizes if passable_width(chosen.radius, size) <= _DOOR]
    if limit <= _DOOR or not better:
        return ()
    return (
        f"the robots pass doors from {limit:.2f} m up, for their cells are {chosen.cell:g} m wide;"
        f" with --cell {better[0]:g} from {passable_width(chosen.radius, better[0]):.2f} m up",
    )


def _robot(name: str, start: Pose, grid: _Grid, chosen: Options) -> ARobot:
    """A robot that knows nothing, wants nothing and does nothing: 4.2.4."""
    x, y, angle = start
    kind = ALocalisingRobot if chosen.localise == "matching" else ARobot
    return kind(
        name,
        grid=grid.cells,
        row=(x - grid.x) / chosen.cell,
        column=(y - grid.y) / chosen.cell,
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
    """A parcel at a marker, on a side of its own: steps of the golden ratio never meet again.

    All sides are below the marker, for pictures have its pin and its name above.
    """
    part = (0.5 + _GOLDEN * (number - 1)) % 1.0
    side = round(_BELOW + _BREADTH * (part - 0.5), 3)
    parcel = AParcel(f"p{number}", x=marker.x, y=marker.y, side=side)
    parcel.stand(marker.name, marker.x, marker.y)
    return parcel


@dataclass(frozen=True, slots=True)
class _Grid:
    """Empty cells, and where in the world the outer corner of cell (0, 0) lies."""

    cells: Cells
    x: float
    y: float


def _empty_grid(floor: OccupancyMap, cell: float) -> _Grid:
    """A grid under the whole map, and one cell more on each side. Raises MapError if too large."""
    rows, columns = floor.cells.shape
    ends = [floor.corner_of((row, column)) for row in (0, rows) for column in (0, columns)]
    x, y = (min(end[axis] for end in ends) for axis in (0, 1))
    far_x, far_y = (max(end[axis] for end in ends) for axis in (0, 1))
    sides = far_x - x, far_y - y
    if not math.prod(side / cell + 3 for side in sides) <= MATRIX_CELLS:
        raise MapError(
            f"a map of {sides[0]:g} m x {sides[1]:g} m is too large for robots with cells of"
            f" {cell:g} m, of which a grid has {MATRIX_CELLS} at most; check the map's resolution,"
            " or take larger cells"
        )
    high, wide = (math.ceil(round(side / cell, 6)) + 2 for side in sides)
    cells = np.zeros((high, wide), np.int16)
    cells.setflags(write=False)
    return _Grid(cells, round(x - cell, 9), round(y - cell, 9))
