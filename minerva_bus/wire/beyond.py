"""What an answer may have beyond the limits, because of the agents of its sender.

A host that has many agents reports all of them, and its frames take what such a world takes. The
limits bound the rest: newborn agents, views and events.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgpack

from minerva_bus.frame.own_agents import OwnAgents
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import Piece, Scene, Value
from minerva_bus.grammar.traversal import walk
from minerva_bus.wire.values import PLAIN_TYPES, plain_scene


@dataclass(frozen=True, slots=True)
class BeyondLimits:
    """What an answer about these agents may have beyond the limits of its type."""

    own: OwnAgents

    def values(self) -> int:
        """Values: four times those of the agents, which may grow and show every part."""
        return 4 * weight_of(self.own.pieces())

    def rows(self) -> int:
        """Rows of columns: some for each agent, to change, show and send events."""
        return weight_of(self.own.pieces())

    def bytes(self) -> int:
        """Bytes."""
        pieces = tuple(self.own.pieces())
        return 4 * len(msgpack.packb(plain_scene(Scene(pieces)))) if pieces else 0


def weight_of(pieces: Iterable[Piece]) -> int:
    """Values of MessagePack, such as lists and numbers, that describe nodes outside columns."""
    count = 0
    for piece in pieces:
        if isinstance(piece, Columns):
            count += piece.count * sum(5 + len(level.columns) for level in piece.levels())
        else:
            nodes = (node for opens, node in walk(Scene((piece,))) if opens)
            count += sum(5 + sum(map(_values_in, node.values)) for node in nodes)
    return count


def _values_in(value: Value) -> int:
    if isinstance(value, Scene):
        return 3 + weight_of(value.pieces)  # The extension, and a list with its count.
    if not isinstance(value, tuple):
        return 1
    # Long lists are usually flat, such as routes.
    plain = PLAIN_TYPES.issuperset(map(type, value))
    return 1 + (len(value) if plain else sum(map(_values_in, value)))
