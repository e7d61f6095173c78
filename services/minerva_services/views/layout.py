"""What views share to fit a picture: extents of items, rows and places of texts, grids."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.poses import Pose
from minerva_services.geometry.picture import Copies, Discs, Item, Marks, Polyline, Texts

Floats = NDArray[np.float64]


def extremes(item: Item) -> tuple[Floats, Floats]:
    """Points (n,) and (n,) in metres whose bounding box contains an item."""
    if isinstance(item, Polyline):
        return item.points[:, 0], item.points[:, 1]
    if isinstance(item, Discs):
        r = item.radius
        return np.concatenate([item.x - r, item.x + r]), np.concatenate([item.y - r, item.y + r])
    if isinstance(item, Copies):
        low, high = item.extents()
        return np.concatenate([low[:, 0], high[:, 0]]), np.concatenate([low[:, 1], high[:, 1]])
    if isinstance(item, Texts):
        return item.x, item.y
    if isinstance(item, Marks):
        return np.zeros(0), np.zeros(0)
    width, depth = item.size
    corners = np.array([item.pose.point(x, y) for x in (0.0, width) for y in (0.0, depth)])
    return corners[:, 0], corners[:, 1]


def flow(widths: Sequence[float], room: float, gap: float) -> list[list[int]]:
    """Numbers of things of these widths, in rows that fit into `room`, at least one per row."""
    rows: list[list[int]] = []
    left = 0.0
    for number, width in enumerate(widths):
        if not rows or left + width > room:
            rows.append([])
            left = 0.0
        rows[-1].append(number)
        left += width + gap
    return rows


def round_step(wanted: float) -> float:
    """The smallest of 1, 2 or 5 times a power of ten that is not below `wanted`."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= wanted)


Rectangle: TypeAlias = tuple[float, float, float, float]
"""Left, top, right and bottom in pixels, y down."""
Ground: TypeAlias = Callable[[Floats, Floats], Floats]
"""The cells of the floor at pixels (n,); NaN beside it."""

MAX_PLACED = 100
"""Labels above which all stand at the first of their places, because comparing takes too long."""
_TOLERATED = 0.02
"""Part of a label that may be covered or cover something else before it takes another place."""


class LabelPlaces:
    """Chooses places of labels: within the picture, apart, and not across walls.

    Args:
        picture: the part of the page that labels should not leave.
        taken: what they should not cover, such as pins and names.
        ground: what the floor has at a pixel; None without a floor.

    """

    def __init__(
        self, picture: Rectangle, taken: Sequence[Rectangle], ground: Ground | None
    ) -> None:
        self._picture, self._taken, self._ground = picture, list(taken), ground
        self._placed = 0

    def choose(self, places: Sequence[Rectangle], x: float, y: float) -> int:
        """The number of the best place of a label at a pixel; the first one is preferred."""
        left, top, right, bottom = self._picture
        if not (left <= x <= right and top <= y <= bottom):
            return 0
        self._placed += 1
        if self._placed > MAX_PLACED:
            return 0
        costs = [self._cost(place, x, y) for place in places]
        best = 0 if costs[0] <= min(costs) + _TOLERATED else costs.index(min(costs))
        self._taken.append(places[best])
        return best

    def _cost(self, place: Rectangle, x: float, y: float) -> float:
        area = max((place[2] - place[0]) * (place[3] - place[1]), 1.0)
        covered = sum(_common(place, other) for other in self._taken) / area
        outside = 1.0 - _common(place, self._picture) / area
        return covered + 2.0 * outside + self._crossed(place, x, y)

    def _crossed(self, place: Rectangle, x: float, y: float) -> float:
        """The part of a place that lies on another kind of floor than its point."""
        if self._ground is None:
            return 0.0
        across, along = np.linspace(place[0], place[2], 12), np.linspace(place[1], place[3], 4)
        (own,) = self._ground(np.array([x]), np.array([y]))
        cells = self._ground(np.tile(across, 4), np.repeat(along, 12))
        return float(np.mean(cells != own)) if own == own else 0.0


def _common(a: Rectangle, b: Rectangle) -> float:
    """The area that two rectangles share."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return max(width, 0.0) * max(height, 0.0)


def cells_at(cells: NDArray[Any], corner: Pose, cell: float, x: Floats, y: Floats) -> Floats:
    """The values of a matrix at positions in metres (n,); NaN beside it.

    Its cell (0, 0) is at the `corner`, and a cell is a square of `cell` metres.
    """
    turn = math.radians(corner.angle)
    east, north = x - corner.x, y - corner.y
    row = np.floor((east * math.cos(turn) + north * math.sin(turn)) / cell)
    column = np.floor((north * math.cos(turn) - east * math.sin(turn)) / cell)
    rows, columns = cells.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    values = np.full(len(x), np.nan)
    values[inside] = cells[row[inside].astype(int), column[inside].astype(int)]
    return values
