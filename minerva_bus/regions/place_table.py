"""Sequences of places: sorted, taken and joined as a table where all have the same length.

That is usual, and then a frame with thousands of agents makes no tuple for each of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, pairwise
from typing import Any, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

Place: TypeAlias = tuple[int, ...]


class PlaceTable(Sequence[Place]):
    """Places of equal length: the rows of a table of int64, shape (n, length)."""

    __slots__ = ("table",)
    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __init__(self, table: NDArray[np.int64]) -> None:
        self.table = table

    @staticmethod
    def numbered(count: int) -> PlaceTable:
        """The places of the nodes of an initial string."""
        return PlaceTable(np.arange(count, dtype=np.int64).reshape(count, 1))

    def __len__(self) -> int:
        return len(self.table)

    @overload
    def __getitem__(self, index: int) -> Place: ...
    @overload
    def __getitem__(self, index: slice) -> PlaceTable: ...
    def __getitem__(self, index: int | slice) -> Place | PlaceTable:
        if isinstance(index, slice):
            return PlaceTable(self.table[index])
        return tuple(self.table[index].tolist())

    def __iter__(self) -> Iterator[Place]:
        return zip(*self.table.T.tolist(), strict=True)

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if isinstance(other, PlaceTable):
            return np.array_equal(self.table, other.table)
        return isinstance(other, Sequence) and [*self] == [*other]


def taken(places: Sequence[Place], rows: NDArray[np.intp]) -> Sequence[Place]:
    """The places with these numbers."""
    if isinstance(places, PlaceTable):
        return PlaceTable(places.table[rows])
    numbers: list[int] = rows.tolist()
    return [places[number] for number in numbers]


def joined(parts: Iterable[Sequence[Place]]) -> Sequence[Place]:
    """The places of several sequences, one after another."""
    present = [part for part in parts if part]
    if len(present) < 2:
        return present[0] if present else ()
    tables = [part.table for part in present if isinstance(part, PlaceTable)]
    if len(tables) == len(present) and len({table.shape[1] for table in tables}) == 1:
        return PlaceTable(np.concatenate(tables))
    places: list[Place] = [*chain.from_iterable(present)]
    return places


def order_of(places: Sequence[Place]) -> NDArray[np.intp]:
    """The numbers of the places in ascending order, equal ones in their order."""
    if isinstance(places, PlaceTable):
        return np.lexsort(places.table.T[::-1])
    return np.array(sorted(range(len(places)), key=places.__getitem__), np.intp)


def repeats(places: Sequence[Place]) -> bool:
    """Whether two neighbours are equal."""
    if isinstance(places, PlaceTable):
        same: Any = (places.table[1:] == places.table[:-1]).all(axis=1)
        return bool(same.any())
    return any(place == following for place, following in pairwise(places))


def numbers_in(places: Sequence[Place]) -> int:
    """How many numbers the places have."""
    return places.table.size if isinstance(places, PlaceTable) else sum(map(len, places))
