"""The figures of agents in pieces of a view."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Piece, Scene
from minerva_bus.grammar.traversal import walk
from minerva_bus.world.halo import Halo


@dataclass(frozen=True, slots=True)
class PieceFigures:
    """The agents' figures of a piece; all have shape (n,), without figures (0,).

    `bounds` are the coordinates by name.
    """

    who: Ids
    at: Mapping[str, NDArray[Any]]


NO_FIGURES: Final = PieceFigures(Ids.of([]), {})


def figures_in(piece: Piece, halo: Halo) -> PieceFigures:
    """The figures of a piece, one for each of its nodes, or none.

    Those without numbers as coordinates are none: the service says what is wrong with them. Without
    a radius, figures need no coordinates, and a node may have several.
    """
    if halo.everywhere:
        who = _ids_everywhere(piece, halo)
        return PieceFigures(who, dict.fromkeys((halo.x, halo.y), np.zeros(len(who))))
    if isinstance(piece, Columns):
        columns = {
            name: column
            for level in piece.levels()
            for name, column in zip(level.names, level.columns, strict=True)
        }
        names = halo.x, halo.y
        who = columns.get(halo.who)
        if who is None or who.dtype != object:
            return NO_FIGURES
        if any(name not in columns or columns[name].dtype.kind not in "if" for name in names):
            return NO_FIGURES
        ids = who.ids if who.ids is not None else Ids.of(who.list())
        return PieceFigures(ids, {name: columns[name].array for name in names})
    values = dict(_values(piece))
    x, y, who = (values.get(name) for name in (halo.x, halo.y, halo.who))
    numbers = all(isinstance(each, int | float) for each in (x, y))
    if not (numbers and isinstance(who, str)):
        return NO_FIGURES
    return PieceFigures(Ids.of([who]), {halo.x: np.array([x]), halo.y: np.array([y])})


def _ids_everywhere(piece: Piece, halo: Halo) -> Ids:
    """The ids of all figures in a piece."""
    texts: list[Any] = []
    if isinstance(piece, Columns):
        for level in piece.levels():
            if halo.figure in ("", level.symbol) and halo.who in level.names:
                texts += level.columns[level.names.index(halo.who)].list()
    else:
        for opens, node in walk(Scene((piece,))):
            if opens and halo.figure in ("", node.symbol) and halo.who in node.names:
                texts.append(node.values[node.names.index(halo.who)])
    return Ids.of([text for text in texts if isinstance(text, str)])


def _values(piece: Piece) -> Iterator[tuple[str, Any]]:
    for opens, node in walk(Scene((piece,))):
        if opens:
            yield from zip(node.names, node.values, strict=True)


def is_figure(piece: Piece, halo: Halo) -> bool:
    """Whether all nodes of a piece have coordinates and an id; without a radius, an id suffices."""
    if halo.everywhere:
        return bool(len(_ids_everywhere(piece, halo)))
    needed = halo.x, halo.y, halo.who
    if not isinstance(piece, Columns):
        values = dict(_values(piece))
        return values.keys() >= {*needed} and bool(values[halo.who])
    columns = {
        name: column
        for level in piece.levels()
        for name, column in zip(level.names, level.columns, strict=True)
    }
    if not columns.keys() >= {*needed}:
        return False
    who = columns[halo.who]
    return who.ids is not None or all(who.list())
