"""Detection of markers in an image, with sub-pixel corners from line fits of their four sides.

OpenCV's corner refinement for ArUco moves corners inwards by 0.1 to 0.7 pixels, so a marker appears
smaller and farther away than it is; the one for AprilTags is exact, but misses markers that the
other detects. Markers are therefore detected by the former, and their sides fitted here, as
AprilTag does (Wang and Olson, "AprilTag 2", IROS 2016): at many positions of each side the edge is
located where the intensity changes most across it, a line is fitted, and corners are the
intersections of lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_services.sensors.vision.images import Grey, opencv

"""An image as rows of pixels, shape (height, width)."""

DICTIONARIES: Final = (
    *(f"{bits}X{bits}_{count}" for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    *("ARUCO_ORIGINAL", "ARUCO_MIP_36h12"),
    *("APRILTAG_16h5", "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11"),
)


@dataclass(frozen=True, slots=True, eq=False)
class DetectedMarker:
    """A marker in an image: its number, and its corners clockwise in pixels, (4, 2)."""

    id: int
    corners: NDArray[np.float64]


Detect: TypeAlias = Callable[[Grey], list[DetectedMarker]]


def dictionary_of(name: str) -> str:
    """OpenCV's name of a dictionary; also accepts `tag36h11`. Raises MisuseError."""
    known = {candidate.lower(): candidate for candidate in DICTIONARIES}
    short = name.lower().removeprefix("dict_")
    # AprilTag's own names, such as tag36h11, are accepted as well.
    match = known.get(short) or known.get(f"april{short.replace('tag', 'tag_', 1)}")
    if match is None:
        there = f"4X4_50 to 7X7_1000, {', '.join(DICTIONARIES[16:])}"
        hint = nearest(name, list(DICTIONARIES), f"expected that of the markers: {there}")
        raise MisuseError(f"vision: unknown dictionary {name!r}{hint}")
    return match


def marker_cells(dictionary: str, number: int) -> NDArray[np.int16]:
    """The squares of a marker to print: 0 black and 1 white, rows from the top.

    Around its black border is a white one, without which no detector recognises it. `dictionary` is
    as in `dictionary_of`. Raises MisuseError for a number that the dictionary lacks.
    """
    aruco: Any = opencv().aruco
    name = dictionary_of(dictionary)
    words = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{name}"))
    count = len(words.bytesList)
    if not 0 <= number < count:
        raise MisuseError(f"vision: {name} has no marker {number}; expected 0 to {count - 1}")
    drawn = aruco.generateImageMarker(words, number, words.markerSize + 2)
    return np.pad(drawn // 255, 1, constant_values=1).astype(np.int16)


def detector(dictionary: str) -> Detect:
    """A detector for the markers of one dictionary. Raises MisuseError without OpenCV."""
    aruco: Any = opencv().aruco
    parameters = aruco.DetectorParameters()
    # This method finds more markers than the exact one for AprilTags; `refined` corrects its
    # corners.
    parameters.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    words = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{dictionary}"))
    aruco_detector = aruco.ArucoDetector(words, parameters)

    def detect(image: Grey) -> list[DetectedMarker]:
        corners, ids, _ = aruco_detector.detectMarkers(image)
        if ids is None:
            return []
        pairs = zip(ids.ravel().tolist(), corners, strict=True)
        markers = [
            DetectedMarker(id, refined(image, quad.reshape(4, 2).astype(np.float64)))
            for id, quad in pairs
        ]
        return sorted(markers, key=lambda marker: (marker.id, *marker.corners[0].tolist()))

    return detect


Reals: TypeAlias = NDArray[np.float64]

_ALONG: Final = np.linspace(0.12, 0.88, 48)
"""Positions along a side at which the edge is sampled; not at the corners, where edges meet."""

# Samples on each side of an edge.
_STEPS: Final = 12
_MAX_REACH: Final = 4.0
"""Maximum search distance in pixels on each side of an edge."""

_CELLS: Final = 8
"""Typical number of cells per side; the search stays within one cell."""

_MIN_RISE: Final = 0.25
"""Part of a marker's contrast by which the image rises across its border."""

_ROUNDS: Final = 3
_MIN_LIMIT: Final = 2.0
"""Pixels by which a corner may be corrected however small the cells are."""


def refined(image: NDArray[np.uint8], corners: Reals) -> Reals:
    """Refined corners of a dark square on a bright background, (4, 2) in pixels, clockwise.

    Integer coordinates are pixel centres. The background may be a narrow margin on dark ground; the
    corners may then be those of the margin. Returns the input if a side has no clear edge.
    """
    fitted = _fitted(image, corners)
    if fitted is None:
        inner = _meeting(_searched(image, corners))
        fitted = _fitted(image, inner) if _is_within(inner, corners) else None
    return corners if fitted is None else fitted


def _fitted(image: NDArray[np.uint8], corners: Reals) -> Reals | None:
    """The corners at the edges near the sides; None if a side has no clear edge nearby."""
    quad, contrast = corners, _contrast(image, corners)
    for _ in range(_ROUNDS):
        # Each round samples across the sides that the previous one found.
        cell = _cell(quad)
        lines, clear = _lines(image, quad, min(_MAX_REACH, max(1.0, 0.8 * cell)), contrast)
        moved = _meeting(lines)
        # Corners in blurred images of markers seen at an angle are off by almost a cell. A larger
        # correction means that the sides are not lines.
        limit = min(_MAX_REACH, max(_MIN_LIMIT, cell))
        if not clear or not np.isfinite(moved).all() or np.abs(moved - corners).max() > limit:
            return None
        quad = moved
    return quad


def _searched(image: NDArray[np.uint8], quad: Reals) -> Reals:
    """The lines of the steepest rises around and inside the sides, (4, 3)."""
    # The border of a marker is a dark cell, and going outwards over the cell inside it, the image
    # can only become darker: for two cells, there is no other rise inside a side.
    cell = _cell(quad)
    steps = np.arange(-1.5 * cell, 0.5 * cell, 0.5)
    middles, normals, samples = _across(image, quad, steps)
    rises = np.diff(samples, axis=2)
    steepest = rises.argmax(axis=2)
    offsets = (steps[steepest] + steps[steepest + 1]) / 2
    weights = np.maximum(rises.max(axis=2), 0.0) ** 2
    points = middles + offsets[..., None] * normals[:, None]
    # Some positions see other edges.
    near = np.abs(offsets - np.median(offsets, axis=1, keepdims=True)) < cell / 2
    sides = zip(points, weights * near, strict=True)
    return np.array([_line(side, weight) for side, weight in sides])


def _is_within(inner: Reals, corners: Reals) -> bool:
    """Whether corners were found, within a cell or two of others."""
    return bool(np.isfinite(inner).all() and np.abs(inner - corners).max() < 2 * _cell(corners))


def _cell(quad: Reals) -> float:
    """The side of a cell in pixels, of the shortest side."""
    return float(np.linalg.norm(np.roll(quad, -1, 0) - quad, axis=1).min()) / _CELLS


def _contrast(image: NDArray[np.uint8], quad: Reals) -> float:
    """The difference between bright and dark inside a square."""
    along = np.linspace(0.0, 1.0, 2 * _CELLS)[:, None]
    left, right = quad[0] + along * (quad[3] - quad[0]), quad[1] + along * (quad[2] - quad[1])
    inside = _bilinear(image, left[:, None] + along * (right - left)[:, None])
    return float(np.subtract(*np.percentile(inside, [90, 10])))


def _across(image: NDArray[np.uint8], quad: Reals, steps: Reals) -> tuple[Reals, Reals, Reals]:
    """Positions along the sides (4, n, 2), outward normals (4, 2), and intensities (4, n, k).

    The intensities are at `steps`, (k,), in pixels outwards.
    """
    ends = np.roll(quad, -1, 0)
    along = ends - quad
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    # Outward, because the square is clockwise.
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    middles = quad[:, None] + _ALONG[:, None] * (ends - quad)[:, None]
    at = middles[:, :, None] + steps[:, None] * normals[:, None, None]
    return middles, normals, _bilinear(image, at)


def _lines(
    image: NDArray[np.uint8], quad: Reals, reach: float, contrast: float
) -> tuple[Reals, bool]:
    """The lines of the sides as (normal x, normal y, distance from the origin), (4, 3).

    And whether each side is an edge of the marker, with at least a part of its contrast.
    """
    steps = np.linspace(-reach, reach, 2 * _STEPS + 1)
    middles, normals, samples = _across(image, quad, steps)
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
    heights = (samples - np.minimum.accumulate(samples, axis=2)).max(axis=2)
    clear = np.median(heights, axis=1) >= _MIN_RISE * contrast
    lines = [_line(side, weight) for side, weight in zip(points, weights, strict=True)]
    return np.array(lines), bool(clear.all())


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
