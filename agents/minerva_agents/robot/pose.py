"""Positions, poses and moves on a grid.

A position is (row, column) in cells, with fractions; the centre of cell (2, 3) is (2.5, 3.5). An
angle is a heading in degrees, counter-clockwise from the direction of growing rows.

A move turns the robot on the spot and then drives it along its new heading, in one frame. As a
string, it is `TRotate<angle>(TMove<dist>(PRobot))`; a robot that stays is `PRobot` alone.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_agents.robot.vocabulary import PRobot, TMove, TRotate
from minerva_bus import Scene, portable
from minerva_bus.grammar.scene import TransformationNode, walk
from minerva_bus.semantics.poses import HasPose, Pose
from minerva_bus.values import fast_dataclass

Cell: TypeAlias = tuple[int, int]
Position: TypeAlias = tuple[float, float]
Reals: TypeAlias = NDArray[np.float64]

TURNING: Final = 180.0
"""Maximum turn rate in degrees per second."""

_TOLERANCE: Final = 1e-6


def cell_of(position: Position) -> Cell:
    """The cell that contains a position."""
    return math.floor(position[0]), math.floor(position[1])


def centre_of(cell: Cell) -> Position:
    """The centre of a cell."""
    return cell[0] + 0.5, cell[1] + 0.5


def at_distance(row: float, column: float, angle: float, dist: float) -> tuple[float, float]:
    """(r + dist cos angle, c + dist sin angle), section 4.2.3; cells and degrees."""
    cos, sin = portable.cos_sin(math.radians(angle))
    return row + dist * cos, column + dist * sin


def at_distances(row: float, column: float, angles: Reals, dist: Reals) -> tuple[Reals, Reals]:
    """`at_distance` of n angles and distances, (n,) each; the same values to the last bit."""
    cos, sin = portable.cos_sin(np.radians(angles))
    return row + dist * cos, column + dist * sin


@fast_dataclass
class Move:
    """A turn in degrees, counter-clockwise, followed by a distance forward in metres."""

    turn: float = 0.0
    dist: float = 0.0


STAY: Final = Move()


@fast_dataclass
class GridPose:
    """A robot's position in cells and heading in degrees."""

    row: float
    column: float
    angle: float

    @property
    def position(self) -> Position:
        """Row and column, in cells."""
        return self.row, self.column

    def after(self, move: Move, cell: float) -> GridPose:
        """The pose after a move; `cell` is the cell side in metres."""
        angle = wrapped(self.angle + move.turn)
        if not move.dist:
            return GridPose(self.row, self.column, angle)
        return GridPose(*at_distance(self.row, self.column, angle, move.dist / cell), angle)


def action_of(move: Move, name: str, radius: float) -> Scene:
    """The string of a move."""
    robot = PRobot(name, radius)
    return robot if move == STAY else TRotate(move.turn)(TMove(move.dist)(robot))


def move_of(action: Scene) -> Move:
    """The move that an action's string denotes."""
    turn = dist = 0.0
    for opens, node in walk(action):
        if opens and isinstance(node, TransformationNode):
            if node.symbol == TRotate.name:
                turn += cast("float", node.values[0])
            elif node.symbol == TMove.name:
                dist += cast("float", node.values[0])
    return Move(turn, dist)


def towards(
    pose: GridPose, row: float, column: float, cell: float, farthest: float, dt: float
) -> Move:
    """One frame's move towards a position, `farthest` metres at most.

    The robot drives only once it faces the position, so it never leaves the straight line.
    """
    down, across = row - pose.row, column - pose.column
    dist = portable.hypot(down, across) * cell
    if dist < _TOLERANCE:
        return STAY
    turn = wrapped(math.degrees(portable.atan2(across, down)) - pose.angle)
    most = TURNING * dt
    if abs(turn) > most:
        return Move(math.copysign(most, turn))
    return Move(turn, min(dist, farthest))


def turn_to(pose: GridPose, angle: float, dt: float) -> Move:
    """One frame's move towards a heading, the shorter way round."""
    turn, most = wrapped(angle - pose.angle), TURNING * dt
    return Move(math.copysign(min(abs(turn), most), turn)) if turn else STAY


def wrapped(angle: float) -> float:
    """The same direction in [-180, 180)."""
    # An angle in range stays as it is: the modulo would round it.
    return angle if -180.0 <= angle < 180.0 else (angle + 180.0) % 360.0 - 180.0


def moved(start: HasPose, before: HasPose, after: HasPose) -> Pose:
    """The pose after the motion from `before` to `after`, applied to `start`."""
    east, north = after.x - before.x, after.y - before.y
    cos, sin = portable.cos_sin(math.radians(start.angle - before.angle))
    return Pose(
        start.x + cos * east - sin * north,
        start.y + sin * east + cos * north,
        start.angle + math.remainder(after.angle - before.angle, 360.0),
    )
