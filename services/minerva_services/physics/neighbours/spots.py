"""What a view shows of agents: where each is, who it is, and what else can be seen of it."""

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
from minerva_bus.grammar.scene import Piece, Scene, walk

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Names:
    """How a view's symbols call the coordinates of an agent, and the agent itself."""

    x: str = "x"
    y: str = "y"
    who: str = "who"


@dataclass(frozen=True, slots=True)
class Spots:
    """n agents in the order of the string; all arrays have the shape (n,)."""

    ids: Ids
    x: Array
    y: Array
    shown: Mapping[str, Array]
    """All values that the symbols of every agent carry, by name."""

    def __len__(self) -> int:
        return len(self.ids)

    def numbers(self) -> dict[str, Array]:
        """What is shown and can be added up."""
        return {name: one for name, one in self.shown.items() if one.dtype != object}


class Reader:
    """Reads views, and texts only where they are others than before."""

    def __init__(self, service: str, names: Names) -> None:
        self._service = service
        self._names = names
        self._ids: dict[int, tuple[Column, Ids]] = {}

    def read(self, view: Scene) -> Spots | None:
        """The agents of a view, None where it shows none. Raises MisuseError."""
        parts = [self._values(many) for many in self._in_columns(view)]
        if not parts:
            return None
        known, self._ids = self._ids, {}
        ids = Ids.concatenated([self._who(part[self._names.who], known) for part in parts])
        common = set(parts[0]).intersection(*parts[1:]) - {self._names.who}
        shown = {name: _joined([part[name] for part in parts]) for name in sorted(common)}
        return Spots(ids, shown[self._names.x], shown[self._names.y], shown)

    def _in_columns(self, view: Scene) -> Iterator[Columns]:
        """All that stands for agents, in the order of the view."""
        for columnar, pieces in groupby(view.pieces, lambda one: isinstance(one, Columns)):
            if columnar:
                yield from filter(self._is_spots, cast("Iterator[Columns]", pieces))
            else:
                yield from self._packed(list(pieces))

    def _packed(self, pieces: Sequence[Piece]) -> Iterator[Columns]:
        for shape, group in runs(pieces):
            if shape is None:
                self._must_be_scenery(Scene(tuple(group)))
            elif self._names.who in _names_in(shape):
                yield merged(group)

    def _is_spots(self, many: Columns) -> bool:
        return many.count > 0 and self._names.who in _names_in(many.shape)

    def _must_be_scenery(self, some: Scene) -> None:
        for _, node in walk(some):
            if self._names.who in node.names:
                raise MisuseError(
                    f"{self._service}: {node.symbol} is not alone where it stands in a view;"
                    " expected one figure for each agent, and transformations round it"
                )

    def _values(self, many: Columns) -> dict[str, Column]:
        found: dict[str, Column] = {}
        for level in many.levels():
            for name, column in zip(level.names, level.columns, strict=True):
                if name in found:
                    raise self._wrong(many, f"has {name} twice")
                found[name] = column
        for name in (self._names.x, self._names.y):
            if name not in found or found[name].dtype.kind not in "fi":
                raise self._wrong(many, f"has no number {name}")
        if found[self._names.who].dtype != object:
            raise self._wrong(many, f"has no text {self._names.who}")
        return found

    def _who(self, texts: Column, known: dict[int, tuple[Column, Ids]]) -> Ids:
        """The ids that a column of texts spells; a column is read once, while it is shown."""
        if texts.ids is not None:
            return texts.ids
        before = known.get(id(texts))
        made = before if before is not None else (texts, Ids.of(texts.list()))
        self._ids[id(texts)] = made
        return made[1]

    def _wrong(self, many: Columns, why: str) -> MisuseError:
        symbols = " around ".join(level.symbol for level in many.levels())
        return MisuseError(f"{self._service}: what stands for an agent in a view, {symbols}, {why}")


def _names_in(shape: Shape) -> Iterator[str]:
    return (name for _, names in shape for name in names)


def _joined(columns: list[Column]) -> Array:
    if len({column.dtype for column in columns}) == 1:
        return Column.concatenated(columns).array
    return np.concatenate([column.array for column in columns])
