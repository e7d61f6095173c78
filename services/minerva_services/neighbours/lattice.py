"""What agents are told of their neighbours on a lattice: how many of them are of which kind."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_services.neighbours.spots import Spots

Array = NDArray[Any]
HOODS = ("moore", "von neumann")


class Lattice:
    """Cells 0 to width - 1 and 0 to height - 1, each with a neighbourhood.

    Args:
        width: in cells.
        height: in cells.
        reach: how many cells a neighbourhood reaches.
        hood: moore, a square; or von neumann, as many steps along the axes.
        periodic: whether opposite edges are one.

    """

    def __init__(
        self, width: float, height: float, reach: float, hood: str, periodic: bool
    ) -> None:
        self._size = _whole("width", width), _whole("height", height)
        self._reach = reach = _whole("radius", reach)
        if periodic and min(self._size) <= 2 * reach:
            raise MisuseError(
                f"neighbours: width and height of a periodic lattice are {width} and {height};"
                f" expected numbers above {2 * reach}, twice the radius"
            )
        self._mode: Any = "wrap" if periodic else "constant"
        square = range(-reach, reach + 1)
        self._around = [
            (reach + dx, reach + dy)
            for dx in square
            for dy in square
            if (dx, dy) != (0, 0) and (hood == "moore" or abs(dx) + abs(dy) <= reach)
        ]

    def cells(self, spots: Spots) -> Array:
        """The number of each agent's cell. Raises MisuseError for one that is in none."""
        found = []
        for name, at, size in zip("xy", (spots.x, spots.y), self._size, strict=True):
            whole = at.astype(np.int64)
            outside = np.flatnonzero((whole != at) | (whole < 0) | (whole >= size))
            if len(outside):
                row = int(outside[0])
                raise MisuseError(
                    f"neighbours: #{spots.ids[row]} is in no cell: its {name} is {at[row]}, and"
                    f" not a whole number from 0 to {size - 1}"
                )
            found.append(whole)
        return found[0] * self._size[1] + found[1]

    def around(self, cells: Array, values: Array | None = None) -> Array:
        """The sum of the neighbours' values for each agent in these cells; None: how many."""
        width, height = self._size
        inside = np.bincount(cells, values, minlength=width * height)
        if values is None:
            inside = inside.astype(np.int32)  # half as much to move
        padded = np.pad(inside.reshape(width, height), self._reach, mode=self._mode)
        total = np.zeros((width, height), inside.dtype)
        for x, y in self._around:
            total += padded[x : x + width, y : y + height]
        own = 1 if values is None else values
        return total.reshape(-1)[cells] + (inside[cells] - own)

    def like(self, cells: Array, kinds: Array) -> Array:
        """How many neighbours have the agent's own value."""
        found = np.zeros(len(cells), np.int64)
        for kind in np.unique(kinds):
            rows = np.flatnonzero(kinds == kind)
            found[rows] = self.around(cells[rows])
        return found


def _whole(name: str, number: float) -> int:
    if number < 1 or number != int(number):
        raise MisuseError(f"neighbours: {name} of a lattice is {number}; expected cells, from 1")
    return int(number)


def counts(
    spots: Spots, lattice: Lattice, wanted: AbstractSet[str], same: str
) -> Mapping[str, Any]:
    """Of each agent's neighbours what is wanted: how many, how many are the same, and means."""
    cells = lattice.cells(spots)
    found: dict[str, Any] = {"number": lattice.around(cells)}
    if "same" in wanted and same in spots.shown:
        found["same"] = lattice.like(cells, spots.shown[same])
    several = np.maximum(found["number"], 1)
    numbers = spots.numbers()
    for name in sorted(numbers.keys() & wanted - found.keys()):
        found[name] = lattice.around(cells, numbers[name]) / several
    return {name: found[name] for name in found.keys() & wanted}
