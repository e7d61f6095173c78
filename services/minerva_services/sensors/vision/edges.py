"""Sub-pixel corners of a marker's square, from line fits of its four sides.

OpenCV's corner refinement for ArUco moves corners inwards by 0.1 to 0.7 pixels, so a marker appears
smaller and farther away than it is; the one for AprilTags is exact, but misses markers that the
other detects. Markers are therefore detected by the former, and their sides fitted here, as
AprilTag does (Wang and Olson, "AprilTag 2", IROS 2016): at many positions of each side the edge is
located where the intensity changes most across it, a line is fitted, and corners are the
intersections of lines.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

Reals: TypeAlias = NDArray[np.float64]

_ALONG: Final = np.linspace(0.12, 0.88, 48)
"""Positions along a side at which the edge is sampled; not at the corners, where edges meet."""

# Samples on each side of an edge.
_STEPS: Final = 12
_MAX_REACH: Final = 4.0
"""Maximum search distance in pixels on each side of an edge."""

_CELLS: Final = 8
"""Typical number of cells per side; the search stays within one cell."""

_ROUNDS: Final = 3
_MIN_LIMIT: Final = 2.0
"""Pixels by which a corner may be corrected however small the cells are."""


def refined(image: NDArray[np.uint8], corners: Reals) -> Reals:
    """Refined corners of a dark square on a bright background, (4, 2) in pixels, clockwise.

    Integer coordinates are pixel centres. Returns the input if a side has no clear edge.
    """
    quad = corners
    for _ in range(_ROUNDS):
        # Each round samples across the sides that the previous one found.
        side = float(np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1).min())
        cell = side / _CELLS
        lines = _lines(image, quad, min(_MAX_REACH, max(1.0, 0.8 * cell)))
        moved = _meeting(lines)
        # Corners in blurred images of markers seen at an angle are off by almost a cell. A larger
        # correction means that the sides are not lines.
        limit = min(_MAX_REACH, max(_MIN_LIMIT, cell))
        if not np.isfinite(moved).all() or np.abs(moved - corners).max() > limit:
            return corners
        quad = moved
    return quad


def _lines(image: NDArray[np.uint8], quad: Reals, reach: float) -> Reals:
    """The lines of the sides as (normal x, normal y, distance from the origin), (4, 3)."""
    ends = np.roll(quad, -1, 0)
    along = ends - quad
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.stack(
        [along[:, 1], -along[:, 0]], axis=1
    )  # outward, because the square is clockwise
    middles = quad[:, None] + _ALONG[:, None] * (ends - quad)[:, None]
    steps = np.linspace(-reach, reach, 2 * _STEPS + 1)
    samples = _bilinear(image, middles[:, :, None] + steps[:, None] * normals[:, None, None])
    # Only rises count: across the border of a dark square, outwards, the image becomes brighter,
    # while falls belong to the marker's pattern or to the surroundings. Squares favour the steepest
    # rise.
    rises = np.maximum(np.diff(samples, axis=2), 0.0) ** 2
    weights = rises.sum(axis=2)
    between = (steps[1:] + steps[:-1]) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        offsets = (rises @ between) / weights
    # A position without any rise has an offset of 0/0. Its weight is 0, but nan would spoil the
    # sums.
    points = middles + np.nan_to_num(offsets)[..., None] * normals[:, None]
    return np.array([_line(side, weight) for side, weight in zip(points, weights, strict=True)])


def _line(points: Reals, weights: Reals) -> Reals:
    """Total least squares line through weighted points; nan if too few have weight."""
    if np.count_nonzero(weights) < len(weights) // 2:
        return np.full(3, np.nan)
    middle = np.average(points, axis=0, weights=weights)
    away = points - middle
    spread = (weights[:, None] * away).T @ away
    # `eigh` sorts eigenvalues ascending: the direction of the smallest spread is the normal.
    normal: Reals = np.linalg.eigh(spread)[1][:, 0]
    return np.array([*normal, normal @ middle])


def _meeting(lines: Reals) -> Reals:
    """Intersections of each side with the previous one: the corners, (4, 2)."""
    first, second = np.roll(lines, 1, 0), lines
    turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        x = (first[:, 2] * second[:, 1] - first[:, 1] * second[:, 2]) / turn
        y = (first[:, 0] * second[:, 2] - first[:, 2] * second[:, 0]) / turn
    return np.stack([x, y], axis=1)


def _bilinear(image: NDArray[np.uint8], at: Reals) -> Reals:
    """Bilinear intensities at points (..., 2) of x and y, clamped at the border."""
    high, wide = image.shape
    # Just below the last index, so that the neighbour at + 1 exists.
    x, y = np.clip(at[..., 0], 0, wide - 1.001), np.clip(at[..., 1], 0, high - 1.001)
    column, row = x.astype(np.intp), y.astype(np.intp)
    x, y = x - column, y - row
    upper = image[row, column] * (1 - x) + image[row, column + 1] * x
    lower = image[row + 1, column] * (1 - x) + image[row + 1, column + 1] * x
    return upper * (1 - y) + lower * y
