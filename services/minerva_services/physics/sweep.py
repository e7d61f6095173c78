"""When does a disc moving along a line touch a segment? In closed form.

The disc shrinks to its centre and the segment grows by the disc's radius (`reach`) to a capsule:
two discs and a slab. The distance to a segment is convex along a line, so a point that does not
approach at the start never will: a touching body can always leave or slide along.
"""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from minerva_bus import portable

Point: TypeAlias = tuple[float, float]
Segment: TypeAlias = tuple[float, float, float, float]

NEVER: Final = math.inf

TOLERANCE: Final = 1e-9
"""Overlap in metres that counts as touching: far above rounding, far below anything visible."""

TOUCH: Final = 1e-9
"""Metres between a line and a wall that count as touching.

On a map of cells, robots often stand and look exactly along the edges of walls and at their
corners. Rounding would decide there otherwise, and differ between two simulations of one robot.
"""


def contact(start: Point, move: Point, wall: Segment, reach: float) -> float:
    """Fraction of a move at which a disc is stopped by a segment.

    Args:
        start: the disc's centre in metres.
        move: its displacement in metres.
        wall: `ax, ay, bx, by` in metres; a point (another disc's centre) if both ends are equal.
        reach: distance at which the two touch, in metres.

    Returns:
        0 to 1, or `NEVER` if the move never penetrates deeper than `TOLERANCE`. Without this
          tolerance, rounding would stop a disc that slides along a wall at the joint of two
          segments.

    """
    # A move is stopped only if it would penetrate deeper than the tolerance, but then at the
    # surface.
    deep = _entry(start, move, wall, reach - TOLERANCE)
    return deep if deep == NEVER else min(deep, _entry(start, move, wall, reach))


def offset(point: Point, wall: Segment) -> Point:
    """Vector in metres from the nearest point of a segment to a point."""
    ax, ay, bx, by = wall
    px, py, lx, ly = point[0] - ax, point[1] - ay, bx - ax, by - ay
    square = lx * lx + ly * ly
    part = min(1.0, max(0.0, (px * lx + py * ly) / square)) if square else 0.0
    return px - part * lx, py - part * ly


def meeting(start: Point, end: Point, wall: Segment) -> float | None:
    """Fraction of a line at which it crosses a wall or touches one of its ends, if it does.

    Args:
        start: the line's beginning in metres.
        end: its end.
        wall: `ax, ay, bx, by` in metres.

    """
    x, y = end[0] - start[0], end[1] - start[1]
    ax, ay, bx, by = wall[0] - start[0], wall[1] - start[1], wall[2] - start[0], wall[3] - start[1]
    square = x * x + y * y
    # Distances from the line of both ends, times its length.
    a, b = x * ay - y * ax, x * by - y * bx
    near = [
        (x * to_x + y * to_y) / square
        for across, to_x, to_y in ((a, ax, ay), (b, bx, by))
        if across * across <= TOUCH * TOUCH * square
    ]
    if a * b < 0:
        near.append((ax * by - ay * bx) / (b - a))
    return min((part for part in near if 0 <= part <= 1), default=None)


def _entry(start: Point, move: Point, wall: Segment, reach: float) -> float:
    """Fraction of the move at which a point enters the capsule, or `NEVER`."""
    away = offset(start, wall)
    # Already in contact: only a move into the wall is stopped.
    if portable.hypot(*away) < reach:
        return 0.0 if away[0] * move[0] + away[1] * move[1] < 0 else NEVER
    return min(
        _disc_entry(start, move, wall[:2], reach),
        _disc_entry(start, move, wall[2:], reach),
        _side_entry(start, move, wall, reach),
    )


def _disc_entry(start: Point, move: Point, centre: Point, reach: float) -> float:
    x, y = start[0] - centre[0], start[1] - centre[1]
    approach = -(x * move[0] + y * move[1])
    if approach <= 0:
        return NEVER
    gap = x * x + y * y - reach * reach
    root = approach * approach - (move[0] * move[0] + move[1] * move[1]) * gap
    if root < 0:
        return NEVER
    # The smaller root, in the form that avoids cancellation.
    return _within_move(gap / (approach + math.sqrt(root)))


def _side_entry(start: Point, move: Point, wall: Segment, reach: float) -> float:
    ax, ay, bx, by = wall
    length = portable.hypot(bx - ax, by - ay)
    if length == 0:
        return NEVER
    ux, uy = (bx - ax) / length, (by - ay) / length
    x, y = start[0] - ax, start[1] - ay
    height, climb = ux * y - uy * x, ux * move[1] - uy * move[0]
    # Mirror the problem, so that the start always lies above the wall.
    if height < 0:
        height, climb = -height, -climb
    if climb >= 0:
        return NEVER
    part = max(0.0, (height - reach) / -climb)  # rounding may put height below reach
    along = (x + part * move[0]) * ux + (y + part * move[1]) * uy
    # The slab covers the segment itself; beyond its ends, `_disc_entry` decides.
    return _within_move(part) if 0 <= along <= length else NEVER


def _within_move(part: float) -> float:
    return max(0.0, part) if part <= 1 else NEVER
