"""Bounding box of a picture, from which levels and sizes of pins follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minerva_services.geometry.picture import Copies, Discs, Picture, Polyline, Texts, Tiles
from minerva_services.views.opengl.camera import Floats
from minerva_services.views.opengl.painting import walled
from minerva_services.views.opengl.solids import placed
from minerva_services.views.solids import Cells


@dataclass(frozen=True, slots=True)
class SceneBox:
    """An axis-aligned box in metres, on the ground."""

    left: float
    bottom: float
    right: float
    top: float
    height: float

    @property
    def corners(self) -> Floats:
        """Its corners, (8, 3)."""
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
        """Half the diagonal of its base."""
        return max(np.hypot(self.right - self.left, self.top - self.bottom) / 2, 1e-3)

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of its base."""
        return (self.left + self.right) / 2, (self.bottom + self.top) / 2

    def around(self, other: SceneBox) -> SceneBox:
        """The smallest box that contains both."""
        return SceneBox(
            min(self.left, other.left),
            min(self.bottom, other.bottom),
            max(self.right, other.right),
            max(self.top, other.top),
            max(self.height, other.height),
        )


def extent_of(picture: Picture, before: SceneBox | None = None) -> SceneBox:
    """The box around a picture: its walls, otherwise its matrices, otherwise everything.

    Without matrices it only grows from `before`, so that the view of a moving world does not jump.
    """
    tiles = [matrix for matrix in picture.of(Tiles) if matrix.cells.size]
    solid = [matrix for matrix in tiles if walled(matrix).any()]
    opaque = [matrix for matrix in tiles if matrix.form.opacity >= 1.0]
    around = solid or opaque or tiles
    if around:
        points = np.concatenate([_corners(matrix) for matrix in around])
        return _box(points, max(matrix.form.height for matrix in around))
    points = np.concatenate([np.zeros((0, 2)), *_points(picture)])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return before or SceneBox(-1.0, -1.0, 1.0, 1.0, 0.0)
    heights = [float(d.height.max()) for d in picture.of(Discs) if len(d)]
    heights += [float(copies.extents()[1][:, 2].max()) for copies in picture.of(Copies)]
    height = max(heights, default=0.0)
    box = _box(points, height)
    room = max(0.05 * box.span, _largest(picture))
    box = SceneBox(box.left - room, box.bottom - room, box.right + room, box.top + room, height)
    return _grown(box, before)


def _grown(box: SceneBox, before: SceneBox | None) -> SceneBox:
    # An equal box, so that the painter does not fit the camera again.
    if before is None or before.around(box) == before:
        return before or box
    return before.around(box)


def _largest(picture: Picture) -> float:
    sizes = [2 * float(d.radius.max()) for d in picture.of(Discs) if len(d)]
    # Solids are within their bounds already.
    return max(sizes, default=0.0 if picture.of(Copies) else 0.2)


def _points(picture: Picture) -> list[Floats]:
    points = [line.points for line in picture.of(Polyline)]
    points += [np.concatenate(copies.extents())[:, :2] for copies in picture.of(Copies)]
    points += [np.column_stack([item.x, item.y]) for item in picture.of(Discs) + picture.of(Texts)]
    return points


def _corners(tiles: Tiles) -> Floats:
    """Corners (4, 2) of the walls, or of the whole matrix if it has none."""
    (low_row, high_row), (low, high) = _reach(walled(tiles))
    x = np.array([low_row, low_row, high_row, high_row]) * tiles.cell
    y = np.array([low, high, low, high]) * tiles.cell
    return np.column_stack(placed(x, y, tiles.pose))


def _reach(mask: Cells) -> tuple[tuple[int, int], tuple[int, int]]:
    if not mask.any():
        return (0, mask.shape[0]), (0, mask.shape[1])
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return (int(rows[0]), int(rows[-1]) + 1), (int(columns[0]), int(columns[-1]) + 1)


def _box(points: Floats, height: float) -> SceneBox:
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    return SceneBox(float(left), float(bottom), float(right), float(top), float(height))
