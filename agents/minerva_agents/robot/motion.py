"""Robot motion: a turn on the spot and a move forward, as a string.

An action is `TRotate<angle>(TMove<dist>(PRobot))`: in one frame the robot first turns, then moves
along its new heading. A robot that stays is `PRobot` alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, cast

from minerva_agents.robot.knowledge import at_distance
from minerva_agents.robot.vocabulary import PRobot, TMove, TRotate
from minerva_bus import Scene, portable
from minerva_bus.grammar.scene import TransformationNode
from minerva_bus.grammar.traversal import walk

TURNING: Final = 180.0
"""Maximum turn rate in degrees per second."""

_TOLERANCE: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Move:
    """A turn in degrees, counter-clockwise, followed by a distance forward in metres."""

    turn: float = 0.0
    dist: float = 0.0


STAY: Final = Move()


@dataclass(frozen=True, slots=True)
class GridPose:
    """A robot's position in cells and heading in degrees."""

    row: float
    column: float
    angle: float

    @property
    def position(self) -> tuple[float, float]:
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
