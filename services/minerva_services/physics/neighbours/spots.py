"""Where the agents of a view are, and their neighbourhoods on a lattice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import groupby
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Column, Columns, Shape, merged, runs
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Piece, Scene, walk

Array = NDArray[Any]
RELATIONS = ("sum", "same", "more")


@dataclass(frozen=True, slots=True)
class Names:
    """Names of the coordinates and the id in a view's symbols."""

    x: str = "x"
    y: str = "y"
    who: str = "who"


@dataclass(frozen=True, slots=True)
class Spots:
    """n agents in the order of the string; all arrays have shape (n,)."""

    ids: Ids
    x: Array
    y: Array
    shown: Mapping[str, Array]
    """Values carried by the symbols of every agent, by name."""

    def __len__(self) -> int:
        return len(self.ids)

    def numbers(self) -> dict[str, Array]:
        """The shown values that are numeric."""
        return {name: array for name, array in self.shown.items() if array.dtype != object}

    def related(self, wanted: AbstractSet[str]) -> Iterator[tuple[str, str, Array]]:
        """The requested names that join a relation to a shown name, with both.

        `sum_size` is of all neighbours; `same_size` and `more_size` count those with the agent's
        own value, or with a greater one.
        """
        for name in sorted(wanted - self.shown.keys()):
            relation, _, shown = name.partition("_")
            values = self.shown.get(shown)
            if values is None or relation not in RELATIONS:
                continue
            # Texts are equal or not, and nothing else.
            if relation == "same" or values.dtype != object:
                yield name, relation, values


class SpotReader:
    """Reads views; decodes a column of ids only when it changed."""

    def __init__(self, service: str, names: Names) -> None:
        self._service = service
        self._names = names
        self._ids: dict[int, tuple[Column, Ids]] = {}

    def read(self, view: Scene) -> Spots | None:
        """The agents of a view, or None if it shows none. Raises MisuseError."""
        parts = [self._values(columns) for columns in self._in_columns(view)]
        if not parts:
            return None
        # Only columns of this view are kept, so the cache does not grow.
        known, self._ids = self._ids, {}
        ids = Ids.concatenated([self._who(part[self._names.who], known) for part in parts])
        common = set(parts[0]).intersection(*parts[1:]) - {self._names.who}
        shown = {name: _joined([part[name] for part in parts]) for name in sorted(common)}
        return Spots(ids, shown[self._names.x], shown[self._names.y], shown)

    def _in_columns(self, view: Scene) -> Iterator[Columns]:
        """All columns that represent agents, in the order of the view."""
        for columnar, pieces in groupby(view.pieces, lambda piece: isinstance(piece, Columns)):
            if columnar:
                yield from filter(self._is_spots, cast("Iterator[Columns]", pieces))
            else:
                yield from self._packed(list(pieces))

    def _packed(self, pieces: Sequence[Piece]) -> Iterator[Columns]:
        # Nodes of one shape become columns, so that the result is the same in both representations.
        for shape, group in runs(pieces):
            if shape is None:
                self._must_be_scenery(Scene(tuple(group)))
            elif self._names.who in _names_in(shape):
                yield merged(group)

    def _is_spots(self, columns: Columns) -> bool:
        return columns.count > 0 and self._names.who in _names_in(columns.shape)

    def _must_be_scenery(self, scene: Scene) -> None:
        for _, node in walk(scene):
            if self._names.who in node.names:
                raise MisuseError(
                    f"{self._service}: {node.symbol} shares its subtree with other figures in the"
                    " view; expected one figure per agent, within transformations"
                )

    def _values(self, columns: Columns) -> dict[str, Column]:
        values: dict[str, Column] = {}
        for level in columns.levels():
            for name, column in zip(level.names, level.columns, strict=True):
                if name in values:
                    raise self._wrong(columns, f"has two values {name}")
                values[name] = column
        for name in (self._names.x, self._names.y):
            if name not in values or values[name].dtype.kind not in "fi":
                raise self._wrong(columns, f"has no number {name}")
        if values[self._names.who].dtype != object:
            raise self._wrong(columns, f"has no text {self._names.who}")
        return values

    def _who(self, texts: Column, known: dict[int, tuple[Column, Ids]]) -> Ids:
        """The ids in a column of texts; a column is decoded once while it is shown."""
        if texts.ids is not None:
            return texts.ids
        # An entry holds its column, so that Python cannot reuse the `id` while the entry exists.
        cached = known.get(id(texts))
        entry = cached if cached is not None else (texts, Ids.of(texts.list()))
        self._ids[id(texts)] = entry
        return entry[1]

    def _wrong(self, columns: Columns, why: str) -> MisuseError:
        symbols = " around ".join(level.symbol for level in columns.levels())
        return MisuseError(f"{self._service}: the figure of an agent, {symbols}, {why}")


def _names_in(shape: Shape) -> Iterator[str]:
    return (name for _, names in shape for name in names)


def _joined(columns: list[Column]) -> Array:
    if len({column.dtype for column in columns}) == 1:
        return Column.concatenated(columns).array
    return np.concatenate([column.array for column in columns])


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

    def compared(self, cells: Array, values: Array) -> tuple[Array, Array, Array]:
        """Number of neighbours of each agent, of those with its own value, and with a greater one.

        It takes time for each different value.
        """
        same, more = np.zeros((2, len(cells)), np.int64)
        so_far = np.zeros(self._size[0] * self._size[1], np.int32)
        for rows in self._rows_by(values):
            own = cells[rows]
            counted = self._counted(own)
            same[rows] = counted[own] - 1
            so_far += counted
            more[rows] = so_far[own]
        return so_far[cells] - 1, same, so_far[cells] - more

    def _rows_by(self, kinds: Array) -> list[Array]:
        """Rows of each value, ascending; cached while the array stays the same object."""
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
        result["number"], result["same"], _ = lattice.compared(cells, spots.shown[same])
    else:
        result["number"] = lattice.around(cells)
    for name, relation, values in spots.related(wanted):
        if relation == "sum":
            result[name] = lattice.around(cells, values)
        else:
            result[name] = lattice.compared(cells, values)[RELATIONS.index(relation)]
    several = np.maximum(result["number"], 1)
    numbers = spots.numbers()
    for name in sorted(numbers.keys() & wanted - result.keys()):
        result[name] = lattice.around(cells, numbers[name]) / several
    return {name: result[name] for name in result.keys() & wanted}
