"""A view as a list of things, part by part: what has not changed is listed once.

A geometric system whose actions add to a list can leave the walk along a view to `ByParts`: it
knows whose part it is in, and goes again only over parts that are others than before.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Generic, TypeVar

from minerva_bus.grammar.columns import walk_pieces
from minerva_bus.grammar.scene import AgentNode, FigureNode, Piece, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry

_T = TypeVar("_T")


class Lister(PlaneGeometry, Generic[_T]):
    """A geometry of the plane whose actions add to `listed`.

    `owner` is the fragment that the walk is in, `~` and a number for a part of a population, and
    `kind` the kind of its agents; both are "" for what is static.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.owner = ""
        self.kind = ""
        self.listed: list[_T] = []


class ByParts(Generic[_T]):
    """Lists one view after another."""

    def __init__(self, lister: Lister[_T]) -> None:
        self._lister = lister
        self._skeleton: Scene | None = None
        self._static: dict[int, list[_T]] = {}
        self._parts: dict[str, tuple[Scene, list[_T]]] = {}

    def listed(self, skeleton: Scene, parts: Mapping[str, Scene]) -> list[_T]:
        """What a view lists: its static skeleton, and in its slots what agents look like."""
        if skeleton is not self._skeleton:
            self._skeleton, self._static = skeleton, {}
            self._parts = {name: known for name, known in self._parts.items() if name in parts}
        pieces = enumerate(skeleton.pieces)
        return list(chain.from_iterable([self._piece(at, piece, parts) for at, piece in pieces]))

    def _piece(self, at: int, piece: Piece, parts: Mapping[str, Scene]) -> list[_T]:
        if isinstance(piece, AgentNode):
            return self._part(piece, parts.get(piece.id))
        if piece.ids is None and not piece.still:
            return self._around(piece, parts)
        if at not in self._static:
            self._static[at] = self._of("", "", Scene((piece,)))
        return self._static[at]

    def _part(self, slot: AgentNode, part: Scene | None) -> list[_T]:
        if part is None:
            return []
        known = self._parts.get(slot.id)
        if known is None or known[0] is not part:
            known = self._parts[slot.id] = part, self._of(slot.id, slot.symbol, part)
        return known[1]

    def _around(self, piece: Piece, parts: Mapping[str, Scene]) -> list[_T]:
        """A transformation with agents in its scope."""
        lister = self._lister
        lister.listed = []
        for opens, node in walk_pieces(Scene((piece,)), lister.many):
            if isinstance(node, AgentNode):
                if opens and node.id in parts:
                    lister.owner, lister.kind = node.id, node.symbol
                    interpret(parts[node.id], lister)
                    lister.owner = lister.kind = ""
            elif isinstance(node, FigureNode):
                lister.draw(node)
            elif opens:
                lister.enter(node)
            else:
                lister.leave(node)
        return lister.listed

    def _of(self, owner: str, kind: str, scene: Scene) -> list[_T]:
        lister = self._lister
        lister.listed, lister.owner, lister.kind = [], owner, kind
        interpret(scene, lister)
        lister.owner = lister.kind = ""
        return lister.listed
