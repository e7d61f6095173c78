"""Neighbourhoods on a lattice: number of neighbours and their kinds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_services.physics.neighbours.spots import Spots

Array = NDArray[Any]
NEIGHBOURHOODS = ("moore", "von neumann")


class Lattice:
    """Cells 0 to width - 1 by 0 to height - 1 and their neighbourhoods.

    Args:
        width: in cells.
        height: in cells.
        reach: radius of a neighbourhood in cells.
        hood: moore (a square) or von neumann (limited Manhattan distance).
        periodic: whether opposite edges are connected.

    """

    def __init__(
        self, width: float, height: float, reach: float, hood: str, periodic: bool
    ) -> None:
        self._size = _cells_of("width", width), _cells_of("height", height)
        self._reach = reach = _cells_of("radius", reach)
        # On a smaller torus a neighbourhood would overlap itself and count agents twice.
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
        self._square = hood == "moore"
        self._kinds: tuple[Array, list[Array]] | None = None

    def cells(self, spots: Spots) -> Array:
        """Cell index of each agent. Raises MisuseError for one outside the lattice."""
        indices = []
        for name, at, size in zip("xy", (spots.x, spots.y), self._size, strict=True):
            whole = at.astype(np.int64, copy=False)
            # Fractions and nan differ from their conversion to integers.
            if len(at) and (whole.min() < 0 or whole.max() >= size or (whole != at).any()):
                row = int(np.argmax((whole != at) | (whole < 0) | (whole >= size)))
                raise MisuseError(
                    f"neighbours: #{spots.ids[row]} is not on the lattice: {name} is {at[row]};"
                    f" expected an integer from 0 to {size - 1}"
                )
            indices.append(whole)
        return indices[0] * self._size[1] + indices[1]

    def around(self, cells: Array, values: Array | None = None) -> Array:
        """Sum of the neighbours' values for each agent in these cells.

        Their number without `values`.
        """
        if values is None:
            # Agents in the same cell are neighbours, too; only the agent itself is subtracted.
            return self._counted(cells)[cells] - 1
        inside = np.bincount(cells, values, self._size[0] * self._size[1])
        total = self._summed(inside.reshape(self._size))
        # The values in the agent's own cell count, except its own.
        return total.reshape(-1)[cells] + (inside[cells] - values)

    def like(self, cells: Array, kinds: Array) -> tuple[Array, Array]:
        """Number of neighbours of each agent, and number of those with the agent's own value."""
        same = np.zeros(len(cells), np.int64)
        all_kinds = np.zeros(self._size[0] * self._size[1], np.int32)
        for rows in self._rows_by(kinds):
            own = cells[rows]
            counted = self._counted(own)
            same[rows] = counted[own] - 1
            all_kinds += counted
        return all_kinds[cells] - 1, same

    def _rows_by(self, kinds: Array) -> list[Array]:
        """Rows of each value; cached while the array stays the same object."""
        if self._kinds is None or self._kinds[0] is not kinds:
            self._kinds = kinds, [np.flatnonzero(kinds == kind) for kind in np.unique(kinds)]
        return self._kinds[1]

    def _counted(self, cells: Array) -> Array:
        """Number of agents in and around each cell, the cell's own included."""
        size = self._size
        inside = np.bincount(cells, minlength=size[0] * size[1]).astype(np.int32).reshape(size)
        if not self._square:
            return (self._summed(inside) + inside).reshape(-1)
        for axis in (0, 1):  # a square window is separable: sum along one axis, then the other
            inside = self._along(inside, axis)
        return inside.reshape(-1)

    def _along(self, inside: Array, axis: int) -> Array:
        padded = self._padded(inside, axis)
        length, total = inside.shape[axis], np.zeros_like(inside)
        for step in range(2 * self._reach + 1):
            total += padded[step : step + length] if axis == 0 else padded[:, step : step + length]
        return total

    def _padded(self, inside: Array, axis: int) -> Array:
        edges = [(self._reach, self._reach) if axis == other else (0, 0) for other in (0, 1)]
        return np.pad(inside, edges, mode=self._mode)

    def _summed(self, inside: Array) -> Array:
        """Sum around each cell, neighbour by neighbour."""
        width, height = self._size
        padded = np.pad(inside, self._reach, mode=self._mode)
        total = np.zeros((width, height), inside.dtype)
        for x, y in self._around:
            total += padded[x : x + width, y : y + height]
        return total


def _cells_of(name: str, number: float) -> int:
    if not 1 <= number < math.inf or number != int(number):
        raise MisuseError(f"neighbours: {name} of a lattice is {number}; expected an integer >= 1")
    return int(number)


def counts(
    spots: Spots, lattice: Lattice, wanted: AbstractSet[str], same: str
) -> Mapping[str, Any]:
    """The requested quantities per agent: number of neighbours, number of equal ones, and means."""
    cells = lattice.cells(spots)
    result: dict[str, Any] = {}
    if "same" in wanted and same in spots.shown:
        result["number"], result["same"] = lattice.like(cells, spots.shown[same])
    else:
        result["number"] = lattice.around(cells)
    several = np.maximum(result["number"], 1)
    numbers = spots.numbers()
    for name in sorted(numbers.keys() & wanted - result.keys()):
        result[name] = lattice.around(cells, numbers[name]) / several
    return {name: result[name] for name in result.keys() & wanted}
