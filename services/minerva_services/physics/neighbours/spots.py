"""What a view shows of agents: position, id and perceptible data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Column, Columns, Shape, merged, runs
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Piece, Scene
from minerva_bus.grammar.traversal import walk

Array = NDArray[Any]


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
