"""Lines of a picture as segments for 3D views, solid or dashed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.picture import Polyline

# Metres above the floor; the length of a dash (_DASH) is in line widths.
_LEVEL = 0.06
_DASH = 3.0
_MAX_DASHES = 400


def segments(line: Polyline) -> NDArray[np.float32]:
    """The segments (n, 2, 3) of a line."""
    points = _dashes(line) if line.form.dashed else np.stack([line.points[:-1], line.points[1:]], 1)
    above = np.full((*points.shape[:-1], 1), _LEVEL)
    return np.concatenate([points, above], axis=-1).astype(np.float32)


def _dashes(line: Polyline) -> NDArray[np.float64]:
    """Dashes (n, 2, 2) along a line, separated by gaps of equal length; shorter in corners."""
    steps = np.hypot(*np.diff(line.points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    length = along[-1]
    # A long line gets longer dashes, which bounds what is sent to the browsers.
    dash = max(_DASH * line.form.width, length / _MAX_DASHES, 1e-6)
    begins = np.arange(0.0, max(length, dash), 2 * dash)
    ends = np.minimum(begins + dash, length)

    def at(distance: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([np.interp(distance, along, line.points[:, axis]) for axis in (0, 1)], 1)

    return np.stack([at(begins), at(ends)], axis=1)
