"""Merging what regions hold or emit into the order of a single coordinator, by place."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, TypeAlias, cast

import numpy as np

from minerva_bus.grammar.batch import AnyEvent, Events, single
from minerva_bus.grammar.column import Rows
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, Piece, Scene
from minerva_bus.regions.places import Place


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


@dataclass(frozen=True, slots=True)
class PlacedEvent:
    """An event of an agent, or a batch, and the place of each sender's unit."""

    places: Sequence[Place]
    event: AnyEvent

    def take(self, rows: Rows) -> PlacedEvent:
        """The events of these rows of a batch."""
        batch = cast("Events", self.event)
        numbers: list[int] = rows.tolist()
        return PlacedEvent([self.places[row] for row in numbers], batch.take(rows))


def merged(parts: Iterable[Units]) -> Units:
    """The units of several parts, sorted by place; neighbours of one shape in columns stay so."""
    holding: list[tuple[Sequence[Place], Piece]] = []
    for part in parts:
        holding += part.each()
    groups = _columns_by_shape([piece for _, piece in holding])
    filled: dict[_Shape, int] = dict.fromkeys(groups, 0)
    # (place, columns, row) of each node in columns, and (place, node, -1) of each other one.
    entries: list[tuple[Place, Piece, int]] = []
    for places, piece in holding:
        if not isinstance(piece, Columns):
            entries.append((places[0], piece, -1))
            continue
        key = _shape(piece)
        first = filled[key]
        entries += [(place, groups[key], first + row) for row, place in enumerate(places)]
        filled[key] += piece.count
    entries.sort(key=_place)
    made: list[Piece] = []
    for _, group in groupby(entries, _held_in):
        run = list(group)
        piece = run[0][1]
        if isinstance(piece, Columns):
            made.append(piece.take(np.array([row for _, _, row in run], np.intp)))
        else:  # The same node may stand several times in a row.
            made += [piece] * len(run)
    ordered = [place for place, _, _ in entries]
    return Units(ordered, tuple(made))


_Shape: TypeAlias = tuple[object, ...]


def _shape(piece: Columns) -> _Shape:
    # Columns of one shape may differ in the types of their values, such as 1 and 1.0.
    return (piece.shape, piece.ids is None, *(column.dtype for column in piece.all_columns()))


def _columns_by_shape(pieces: Iterable[Piece]) -> dict[_Shape, Columns]:
    groups: dict[_Shape, list[Columns]] = {}
    for piece in pieces:
        if isinstance(piece, Columns):
            groups.setdefault(_shape(piece), []).append(piece)
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
    places = [place for each in group for place in each.places]
    order = sorted(range(len(places)), key=places.__getitem__)
    batches = [each.event for each in group if isinstance(each.event, Events)]
    batch = Events.concatenated(batches) if len(batches) == len(group) else None
    if batch is not None:
        return [batch.take(np.array(order, np.intp))]
    events: list[Event] = list(single(each.event for each in group))
    return [events[row] for row in order]


def _held_in(entry: tuple[Place, Piece, int]) -> int:
    return id(entry[1])


def _place(entry: tuple[Place, Any, int]) -> Place:
    return entry[0]
