"""Densify sparse scans: interpolate points between neighbouring hits on one wall."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable

Reals: TypeAlias = NDArray[np.float64]


def filled(dist: Reals, angle: Reals, max_gap: float) -> tuple[Reals, Reals]:
    """The hits, plus points one cell apart between neighbours at most `max_gap` cells apart.

    Distances are cells, angles degrees, (n,) each. A laser with few beams samples a wall sparsely,
    and without interpolation a scan would fit best where its points coincide with those of the
    previous scan. A laser with many beams needs none: interpolation would round off corners.
    """
    down, right = dist * portable.cos(np.radians(angle)), dist * portable.sin(np.radians(angle))
    far_down, far_right = np.roll(down, -1) - down, np.roll(right, -1) - right
    gaps = portable.hypot(far_down, far_right)
    counts = np.where(gaps <= max_gap, np.maximum(np.ceil(gaps), 1), 1).astype(np.intp)
    which = np.repeat(np.arange(len(dist)), counts)
    firsts = np.cumsum(counts) - counts
    parts = (np.arange(len(which)) - firsts[which]) / counts[which]
    down, right = down[which] + parts * far_down[which], right[which] + parts * far_right[which]
    return portable.hypot(down, right), np.degrees(portable.atan2(right, down))
