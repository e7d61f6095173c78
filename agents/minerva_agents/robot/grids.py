"""Grids of free and blocked cells, and validation of map input."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import MinervaError

Mask: TypeAlias = NDArray[np.bool_]


class MapError(MinervaError, ValueError):
    """A map is invalid, or a request cannot be satisfied on it."""


def check_grid(grid: Mask, who: str, name: str) -> None:
    """Raise MapError, naming the caller `who`, unless `grid` is a 2-D array of bool."""
    if grid.ndim != 2 or grid.dtype != np.bool_:
        kind = f"{grid.ndim}-D of {grid.dtype}"
        raise MapError(f"{who}: {name} is {kind}, expected a 2-D array of bool [row, column]")
