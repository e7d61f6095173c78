"""A scan of few beams as one of many: there is a wall between neighbouring hits."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Reals: TypeAlias = NDArray[np.float64]


def filled(dist: Reals, angle: Reals, most: float) -> tuple[Reals, Reals]:
    """The hits, and points a cell apart between neighbours that are at most so many cells apart.

    Distances are cells, angles degrees, (n,) each. Few beams meet a wall in points far from one
    another. Without others between them, a scan would seem to fit best where its points fall on
    those of the scan before. A laser with many beams needs none: they round corners off.
    """
    down, right = dist * np.cos(np.radians(angle)), dist * np.sin(np.radians(angle))
    far_down, far_right = np.roll(down, -1) - down, np.roll(right, -1) - right
    gaps = np.hypot(far_down, far_right)
    counts = np.where(gaps <= most, np.maximum(np.ceil(gaps), 1), 1).astype(np.intp)
    which = np.repeat(np.arange(len(dist)), counts)
    firsts = np.cumsum(counts) - counts
    parts = (np.arange(len(which)) - firsts[which]) / counts[which]
    down, right = down[which] + parts * far_down[which], right[which] + parts * far_right[which]
    return np.hypot(down, right), np.degrees(np.arctan2(right, down))
