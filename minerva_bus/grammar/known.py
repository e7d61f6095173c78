"""Values that the parameters of a symbol have in a string."""

from __future__ import annotations

from collections.abc import Iterator

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.limits import Of
from minerva_bus.grammar.scene import FigureNode, Piece, Scene, Value


def values_of(scene: Scene, of: Of) -> Iterator[Value]:
    """The values that a parameter of a symbol has in a string, from left to right."""
    pieces: list[Piece] = list(reversed(scene.pieces))
    while pieces:
        piece = pieces.pop()
        if isinstance(piece, Columns):
            for level in piece.levels():
                if level.symbol == of.symbol:
                    yield from level.columns[level.names.index(of.parameter)].list()
            continue
        if piece.symbol == of.symbol:
            yield piece.values[piece.names.index(of.parameter)]
        if not isinstance(piece, FigureNode):
            pieces += reversed(piece.scope.pieces)
