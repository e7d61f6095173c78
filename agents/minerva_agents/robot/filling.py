"""A scan of few beams as one of many: there is a wall between neighbouring hits."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable

Reals: TypeAlias = NDArray[np.float64]


def filled(dist: Reals, angle: Reals, most: float) -> tuple[Reals, Reals]:
    """The hits, and points a cell apart between neighbours that are at most so many cells apart.

    Distances are cells, angles degrees, (n,) each. Few beams meet a wall in points far from one
    another. Without others between them, a scan would seem to fit best where its points fall on
    those of the scan before. A laser with many beams needs none: they round corners off.
    """
    down, right = dist * portable.cos(np.radians(angle)), dist * portable.sin(np.radians(angle))
    far_down, far_right = np.roll(down, -1) - down, np.roll(right, -1) - right
    gaps = portable.hypot(far_down, far_right)
    counts = np.where(gaps <= most, np.maximum(np.ceil(gaps), 1), 1).astype(np.intp)
    which = np.repeat(np.arange(len(dist)), counts)
    firsts = np.cumsum(counts) - counts
    parts = (np.arange(len(which)) - firsts[which]) / counts[which]
    down, right = down[which] + parts * far_down[which], right[which] + parts * far_right[which]
    return portable.hypot(down, right), np.degrees(portable.atan2(right, down))
