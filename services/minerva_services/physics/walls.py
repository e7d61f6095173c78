"""Wall segments from an occupancy matrix: the outline of its free cells."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_services.physics.errors import PhysicsError, finite, positive

Segments: TypeAlias = NDArray[np.float64]

FREE: Final = 0


def wall_segments(
    cells: NDArray[np.integer],
    resolution: float,
    x: float = 0.0,
    y: float = 0.0,
    angle: float = 0.0,
) -> Segments:
    """The edges between free and solid cells, with collinear runs merged.

    Args:
        cells: (rows, columns), rows along x, columns along y; 0 is free, every other value (100
          occupied, -1 unknown) and everything outside the matrix is solid.
        resolution: side of a cell in metres.
        x: world x of the matrix' lower-left corner in metres.
        y: world y of that corner in metres.
        angle: rotation of the matrix about that corner in degrees, counter-clockwise.

    Returns:
        (n, 4) rows `ax, ay, bx, by` in metres. Free space lies to the left of a → b.

    Raises:
        PhysicsError: the matrix is not two-dimensional, or a number is invalid.

    """
    if cells.ndim != 2:
        raise PhysicsError(f"occupancy matrix: expected rows and columns, found {cells.shape}")
    positive("occupancy matrix, resolution in metres", resolution)
    finite("occupancy matrix, place of its lower-left corner", x, y, angle)
    # The padding is solid, like everything outside the matrix. Signed integers, because the sign of
    # a difference tells on which side free space lies.
    free = np.pad((cells == FREE).astype(np.int8), 1)
    across_x = _runs(np.diff(free[:, 1:-1], axis=0))
    across_y = _runs(np.diff(free[1:-1, :], axis=1).T)
    corners = np.concatenate([_on_rows(across_x), _on_columns(across_y)])
    return _placed(corners * resolution, x, y, angle)


def _runs(steps: NDArray[np.int8]) -> NDArray[np.int64]:
    """Maximal runs of equal steps other than 0 along each line: (n, 4) line, start, end, step."""
    padded = np.pad(steps, ((0, 0), (1, 1)))
    changes = np.diff(padded, axis=1) != 0
    lines, starts = np.nonzero(changes & (padded[:, 1:] != 0))
    # Both scans go line by line, so the k-th end belongs to the k-th start.
    _, ends = np.nonzero(changes & (padded[:, :-1] != 0))
    return np.stack([lines, starts, ends, steps[lines, starts]], axis=1).astype(np.int64)


def _on_rows(runs: NDArray[np.int64]) -> Segments:
    """Segments at constant x; they point to -y where free space begins towards +x."""
    line, start, end = runs[:, 0], runs[:, 1], runs[:, 2]
    rising = runs[:, 3] > 0
    first, last = np.where(rising, end, start), np.where(rising, start, end)
    return np.stack([line, first, line, last], axis=1).astype(np.float64)


def _on_columns(runs: NDArray[np.int64]) -> Segments:
    """Segments at constant y; they point to +x where free space begins towards +y."""
    line, start, end = runs[:, 0], runs[:, 1], runs[:, 2]
    rising = runs[:, 3] > 0
    first, last = np.where(rising, start, end), np.where(rising, end, start)
    return np.stack([first, line, last, line], axis=1).astype(np.float64)


def _placed(segments: Segments, x: float, y: float, angle: float) -> Segments:
    """The segments, rotated by `angle` degrees about the origin and shifted by (x, y)."""
    cos, sin = portable.cos_sin(math.radians(angle))
    along, across = segments[:, 0::2], segments[:, 1::2]
    placed = np.empty_like(segments)
    placed[:, 0::2] = x + (along * cos - across * sin)
    placed[:, 1::2] = y + (along * sin + across * cos)
    return placed
