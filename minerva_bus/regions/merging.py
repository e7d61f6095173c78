"""Merging what regions hold or emit into the order of a single coordinator, by place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from operator import is_
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.own_agents import OwnAgents
from minerva_bus.grammar.batch import AnyEvent, Events, single
from minerva_bus.grammar.column import Rows
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, Piece, Scene
from minerva_bus.regions.place_table import Place, joined, numbers_in, order_of, taken


@dataclass(frozen=True, slots=True)
class Units:
    """Nodes at the outermost level of a string, with the place of each; the unit of migration.

    A transformation around agents is one unit.
    """

    places: Sequence[Place]
    pieces: tuple[Piece, ...]

    def __bool__(self) -> bool:
        return bool(self.pieces)

    @property
    def scene(self) -> Scene:
        """The string of the units."""
        return Scene(self.pieces) if self.pieces else EMPTY

    def each(self) -> Iterator[tuple[Sequence[Place], Piece]]:
        """Each piece with the places of its nodes."""
        end = 0
        for piece in self.pieces:
            begin, end = end, end + piece.count
            yield self.places[begin:end], piece


def agents_in(parts: Callable[[], Iterable[Units]]) -> OwnAgents:
    """The agents of these parts, with the numbers in their places.

    Only an answer beyond the limits needs the `parts`, which may be those of all regions.
    """

    def pieces() -> Iterator[Piece]:
        return chain.from_iterable(each.pieces for each in parts())

    def places() -> int:
        return sum(numbers_in(each.places) for each in parts())

    return OwnAgents(pieces, places)


@dataclass(frozen=True, slots=True)
class PlacedEvent:
    """An event of an agent, or a batch, and the place of each sender's unit."""

    places: Sequence[Place]
    event: AnyEvent

    def take(self, rows: Rows) -> PlacedEvent:
        """The events of these rows of a batch; of a single event, all rows or none."""
        batch, places = self.event, taken(self.places, rows)
        return PlacedEvent(places, batch if isinstance(batch, Event) else batch.take(rows))


class Merger:
    """Repeatedly merges the units of several parts, sorted by place.

    While all parts have the nodes that they had, it keeps their order, so that merging costs what
    copying columns costs.
    """

    def __init__(self) -> None:
        self._places: list[Sequence[Place]] = []
        self._forms: list[_Form] = []
        self._kinds: list[str] = []
        self._order: Sequence[Place] = ()
        self._runs: list[tuple[_Shape | None, NDArray[np.intp]]] = []

    def merge(self, parts: Iterable[Units], kinds: Iterable[str] = ()) -> Units:
        """The units in the order of one string; neighbours of one shape in columns stay so.

        `kinds` are those of the agents that show the pieces of all parts, if columns of different
        kinds must stay apart.
        """
        parts = [*parts]
        pieces = [piece for part in parts for piece in part.pieces]
        self._kinds = [*kinds] or [""] * len(pieces)
        places, forms = [part.places for part in parts], [*map(_form, pieces, self._kinds)]
        same = len(places) == len(self._places) and all(map(is_, places, self._places))
        if not same or forms != self._forms:
            self._places, self._forms = places, forms
            self._sort(parts)
        groups = _columns_by_shape(zip(pieces, self._forms, strict=True))
        made: list[Piece] = []
        for shape, numbers in self._runs:
            if shape is None:
                made += [pieces[number] for number in numbers.tolist()]
            else:
                made.append(groups[shape].take(numbers))
        return Units(self._order, tuple(made))

    @property
    def kinds(self) -> list[str]:
        """The kind of each piece of the last result."""
        kinds: list[str] = []
        for shape, numbers in self._runs:
            if shape is None:
                kinds += [self._kinds[number] for number in numbers.tolist()]
            else:
                kinds.append(shape[0])
        return kinds

    def _sort(self, parts: Iterable[Units]) -> None:
        """Note the order of all nodes: runs of numbers of pieces, or of rows of one shape."""
        holders: dict[_Shape | None, int] = {None: 0}
        filled: dict[_Shape, int] = {}
        numbers: list[NDArray[np.intp]] = []
        for number, (shape, count) in enumerate(self._forms):
            first = number if shape is None else filled.get(shape, 0)
            numbers.append(np.arange(first, first + count))
            if shape is not None:
                filled[shape] = first + count
                holders.setdefault(shape, len(holders))
        places = joined(part.places for part in parts)
        order = order_of(places)
        self._order, self._runs = taken(places, order), []
        if not len(order):
            return
        held_in = [holders[shape] for shape, _ in self._forms]
        holder = np.repeat(held_in, [count for _, count in self._forms])[order]
        shapes: list[_Shape | None] = [*holders]
        all_numbers: NDArray[np.intp] = np.concatenate(numbers)[order]
        ends = [*(np.flatnonzero(np.diff(holder)) + 1).tolist(), len(order)]
        for begin, end in pairwise([0, *ends]):
            self._runs.append((shapes[int(holder[begin])], all_numbers[begin:end]))


def merged(parts: Iterable[Units]) -> Units:
    """The units of several parts, sorted by place; neighbours of one shape in columns stay so."""
    return Merger().merge(parts)


_Shape: TypeAlias = tuple[str, tuple[object, ...]]
"""A kind, and what columns must have in common to be joined."""

_Form: TypeAlias = tuple[_Shape | None, int]
"""The shape of a piece in columns, or None, and the number of its nodes."""


def _form(piece: Piece, kind: str) -> _Form:
    return ((kind, _shape(piece)) if isinstance(piece, Columns) else None), piece.count


def _shape(piece: Columns) -> tuple[object, ...]:
    # Columns of one shape may differ in the types of their values, such as 1 and 1.0.
    return (piece.shape, piece.ids is None, *(column.dtype for column in piece.all_columns()))


def _columns_by_shape(pieces: Iterable[tuple[Piece, _Form]]) -> dict[_Shape, Columns]:
    groups: dict[_Shape, list[Columns]] = {}
    for piece, (shape, _) in pieces:
        if shape is not None and isinstance(piece, Columns):
            groups.setdefault(shape, []).append(piece)
    return {shape: Columns.concatenated(group) for shape, group in groups.items()}


def in_order(placed: Iterable[PlacedEvent]) -> list[AnyEvent]:
    """The events of agents, by type and then by the place of the sender.

    Events with equal places are of one region, and keep their order.
    """
    by_type: dict[str, list[PlacedEvent]] = {}
    for each in placed:
        by_type.setdefault(each.event.type, []).append(each)
    return [event for _, group in sorted(by_type.items()) for event in _of_one_type(group)]


def _of_one_type(group: Sequence[PlacedEvent]) -> Sequence[AnyEvent]:
    order = order_of(joined(each.places for each in group))
    batches = [each.event for each in group if isinstance(each.event, Events)]
    batch = Events.concatenated(batches) if len(batches) == len(group) else None
    if batch is not None:
        return [batch.take(order)]
    events: list[Event] = list(single(each.event for each in group))
    rows: list[int] = order.tolist()
    return [events[row] for row in rows]
