"""Incremental interpretation of views: a part that has not changed is not interpreted again.

A geometric system whose actions append items to a list derives from `ItemGeometry`. `ByParts` runs
it over one view after another and keeps the items of each part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain, groupby
from typing import Any, Generic, TypeVar

from minerva_bus.grammar.columns import walk_pieces
from minerva_bus.grammar.scene import AgentNode, FigureNode, Piece, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry

_T = TypeVar("_T")
_Batch = TypeVar("_Batch")


class ItemGeometry(PlaneGeometry, Generic[_T]):
    """A geometry of the plane whose actions append to `items`.

    `owner` is the current fragment, whose name begins with `~` if it is a part of a population, and
    `kind` the kind of its agents; both are "" in static parts.
    """

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.owner = ""
        self.kind = ""
        self.items: list[_T] = []


class ByParts(Generic[_T]):
    """The items of one view after another, cached by part."""

    def __init__(self, geometry: ItemGeometry[_T]) -> None:
        self._geometry = geometry
        self._skeleton: Scene | None = None
        self._static: dict[int, list[_T]] = {}
        self._parts: dict[str, tuple[Scene, list[_T]]] = {}

    def items(self, skeleton: Scene, parts: Mapping[str, Scene]) -> list[_T]:
        """The items of a view in order: static ones, and those of the parts in its slots."""
        # The skeleton is the same object for as long as static parts and slots do not change.
        if skeleton is not self._skeleton:
            self._skeleton, self._static = skeleton, {}
            # Parts of agents that no longer exist would otherwise stay in memory.
            self._parts = {name: known for name, known in self._parts.items() if name in parts}
        pieces = enumerate(skeleton.pieces)
        return list(chain.from_iterable([self._piece(at, piece, parts) for at, piece in pieces]))

    def _piece(self, at: int, piece: Piece, parts: Mapping[str, Scene]) -> list[_T]:
        # A slot; then a transformation with slots inside; then a static piece.
        if isinstance(piece, AgentNode):
            return self._part(piece, parts.get(piece.id))
        if piece.ids is None and not piece.still:
            return self._around(piece, parts)
        if at not in self._static:
            self._static[at] = self._interpreted("", "", Scene((piece,)))
        return self._static[at]

    def _part(self, slot: AgentNode, part: Scene | None) -> list[_T]:
        if part is None:
            return []
        known = self._parts.get(slot.id)
        # Identity suffices: a host that has not visualized a fragment again sends nothing for it,
        # so its view is the object of the previous frame.
        if known is None or known[0] is not part:
            known = self._parts[slot.id] = part, self._interpreted(slot.id, slot.symbol, part)
        return known[1]

    def _around(self, piece: Piece, parts: Mapping[str, Scene]) -> list[_T]:
        """The items of a transformation with slots in its scope.

        They are not cached by slot, because their poses depend on the transformation.
        """
        geometry = self._geometry
        geometry.items = []
        for opens, node in walk_pieces(Scene((piece,)), geometry.many):
            if isinstance(node, AgentNode):
                # The part is interpreted in its place, with the pose of the transformations around
                # it.
                if opens and node.id in parts:
                    geometry.owner, geometry.kind = node.id, node.symbol
                    interpret(parts[node.id], geometry)
                    geometry.owner = geometry.kind = ""
            elif isinstance(node, FigureNode):
                geometry.draw(node)
            elif opens:
                geometry.enter(node)
            else:
                geometry.leave(node)
        return geometry.items

    def _interpreted(self, owner: str, kind: str, scene: Scene) -> list[_T]:
        geometry = self._geometry
        geometry.items, geometry.owner, geometry.kind = [], owner, kind
        interpret(scene, geometry)
        geometry.owner = geometry.kind = ""
        return geometry.items


def batched(
    items: Iterable[Any], single: type[Any], pack: Callable[[Sequence[Any]], _Batch]
) -> list[_Batch]:
    """The items in order, each run of neighbours of the class `single` packed as one batch."""
    batches: list[_Batch] = []
    for is_single, run in groupby(items, lambda item: isinstance(item, single)):
        group = list(run)
        batches += [pack(group)] if is_single else group
    return batches
