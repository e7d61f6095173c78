"""How large a picture is, and so how high things lie and how large pins are in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minerva_bus.semantics.picture import Discs, Picture, Polyline, Texts, Tiles
from minerva_services.views.opengl.boxes import Cells
from minerva_services.views.opengl.camera import Floats
from minerva_services.views.opengl.painting import walled
from minerva_services.views.opengl.solids import placed


@dataclass(frozen=True, slots=True)
class Extent:
    """An upright box, metres."""

    left: float
    bottom: float
    right: float
    top: float
    height: float

    @property
    def corners(self) -> Floats:
        """Its corners (8, 3)."""
        return np.array(
            [
                (x, y, z)
                for x in (self.left, self.right)
                for y in (self.bottom, self.top)
                for z in (0.0, self.height)
            ]
        )

    @property
    def span(self) -> float:
        """Half of its ground's diagonal."""
        return max(np.hypot(self.right - self.left, self.top - self.bottom) / 2, 1e-3)

    @property
    def middle(self) -> tuple[float, float]:
        """The middle of its ground."""
        return (self.left + self.right) / 2, (self.bottom + self.top) / 2

    def around(self, other: Extent) -> Extent:
        """The smallest box around both."""
        return Extent(
            min(self.left, other.left),
            min(self.bottom, other.bottom),
            max(self.right, other.right),
            max(self.top, other.top),
            max(self.height, other.height),
        )


def extent_of(picture: Picture, before: Extent | None = None) -> Extent:
    """The box around a picture: its walls, or else its matrices; without them, all it shows.

    Without matrices it only grows from `before`, so that a moving world does not jump.
    """
    tiles = [one for one in picture.of(Tiles) if one.cells.size]
    solid = [one for one in tiles if walled(one).any()]
    opaque = [one for one in tiles if one.form.opacity >= 1.0]
    around = solid or opaque or tiles
    if around:
        points = np.concatenate([_corners(one) for one in around])
        return _box(points, max(one.form.height for one in around))
    points = np.concatenate([np.zeros((0, 2)), *_points(picture)])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return before or Extent(-1.0, -1.0, 1.0, 1.0, 0.0)
    height = max((float(d.height.max()) for d in picture.of(Discs) if len(d)), default=0.0)
    found = _box(points, height)
    room = max(0.05 * found.span, _largest(picture))
    found = Extent(
        found.left - room, found.bottom - room, found.right + room, found.top + room, height
    )
    return _grown(found, before)


def _grown(found: Extent, before: Extent | None) -> Extent:
    if before is None or before.around(found) == before:
        return before or found
    return before.around(found)


def _largest(picture: Picture) -> float:
    return max((2 * float(d.radius.max()) for d in picture.of(Discs) if len(d)), default=0.2)


def _points(picture: Picture) -> list[Floats]:
    found = [one.points for one in picture.of(Polyline)]
    found += [np.column_stack([one.x, one.y]) for one in picture.of(Discs) + picture.of(Texts)]
    return found


def _corners(tiles: Tiles) -> Floats:
    """The corners (4, 2) of the walls or, where a matrix has none, of all of it."""
    (low_row, high_row), (low, high) = _reach(walled(tiles))
    x = np.array([low_row, low_row, high_row, high_row]) * tiles.cell
    y = np.array([low, high, low, high]) * tiles.cell
    return np.column_stack(placed(x, y, tiles.pose))


def _reach(mask: Cells) -> tuple[tuple[int, int], tuple[int, int]]:
    if not mask.any():
        return (0, mask.shape[0]), (0, mask.shape[1])
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return (int(rows[0]), int(rows[-1]) + 1), (int(columns[0]), int(columns[-1]) + 1)


def _box(points: Floats, height: float) -> Extent:
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    return Extent(float(left), float(bottom), float(right), float(top), float(height))
