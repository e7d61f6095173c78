"""Values, strings and events as plain data: section 3 of PROTOCOL.md.

A string is flat, in reading order, so that its depth costs no recursion:

    scene  = [count of top pieces, piece, piece, ...]   each node is followed by its scope's
    piece  = node | columns                             nodes of one shape (columns.py)
    node   = [symbol, values]                           figure
           | [symbol, values, count]                    transformation
           | [symbol, id, values, count]                agent; values is nil if it has none,
                                                        and for a mere slot
    event  = [type, values] | [type, values, condition, sender, [receivers]]
           | events                                     a batch of one type (columns.py)

`values` are in the order of the vocabulary's fields. A matrix is extension 1 (a byte `i` or `r`,
rows and columns as little-endian uint32, then int16 or float64 values in row order, little
endian); a string as a value is extension 2 (a packed scene).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import chain
from typing import Any

import msgpack
import numpy as np

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import AnyEvent, Events
from minerva_bus.grammar.scene import (
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
)
from minerva_bus.wire.columns import plain_columns
from minerva_bus.wire.columns import plain_events as plain_batch
from minerva_bus.wire.weighing import STRING

MATRIX = 1
"""Extension type of a matrix."""
HEADER = struct.Struct("<cII")
"""Head of a matrix: the kind of its numbers, rows and columns."""
PLAIN_TYPES = frozenset((float, int, bool, str))


def plain_value(value: Value) -> Any:
    """A value as plain data."""
    if isinstance(value, np.ndarray):
        real = value.dtype == np.float64
        cells = np.ascontiguousarray(value, "<f8" if real else "<i2")
        head = HEADER.pack(b"r" if real else b"i", *value.shape)
        return msgpack.ExtType(MATRIX, b"".join((head, cells.data)))
    if isinstance(value, Scene):
        return msgpack.ExtType(STRING, msgpack.packb(plain_scene(value)))
    if isinstance(value, tuple):
        if PLAIN_TYPES.issuperset(map(type, value)) or are_plain_lists(value, tuple):
            return list(value)
        return [plain_value(item) for item in value]
    return value


def plain_scene(scene: Scene) -> list[Any]:
    """A string as a flat list, so that its depth costs no recursion."""
    flat: list[Any] = [len(scene.pieces)]
    stack = [iter(scene.pieces)]
    while stack:
        for piece in stack[-1]:
            if isinstance(piece, Columns):
                flat.append(plain_columns(piece))
                continue
            flat.append(_plain_node(piece))
            # The iterator of this level stays on the stack and continues after the scope.
            if not isinstance(piece, FigureNode) and piece.scope.pieces:
                stack.append(iter(piece.scope.pieces))
                break
        else:
            stack.pop()
    return flat


def _plain_node(node: Node) -> list[Any]:
    values = _plain_values(node.values)
    if isinstance(node, FigureNode):
        return [node.symbol, values]
    if isinstance(node, TransformationNode):
        return [node.symbol, values, len(node.scope.pieces)]
    return [node.symbol, node.id, values if node.names else None, len(node.scope.pieces)]


def _plain_values(values: Sequence[Value]) -> list[Any]:
    if PLAIN_TYPES.issuperset(map(type, values)):  # The usual case: nothing to convert.
        return list(values)
    return [value if value.__class__ in PLAIN_TYPES else plain_value(value) for value in values]


def plain_event(event: AnyEvent) -> list[Any]:
    """An event, or a batch."""
    if isinstance(event, Events):
        return plain_batch(event)
    values = _plain_values(event.values)
    if event.condition or event.sender or event.receivers:
        return [event.type, values, event.condition, event.sender, list(event.receivers)]
    return [event.type, values]


def plain_event_list(events: Sequence[AnyEvent]) -> list[Any]:
    """Events in order."""
    return [plain_event(event) for event in events]


def are_plain_lists(items: Sequence[Any], kind: type[Any]) -> bool:
    """Whether all items are lists (of the type `kind`) of plain values.

    Decided without a call for each of them, because a message may have tens of thousands.
    """
    if not {kind}.issuperset(map(type, items)):
        return False
    return PLAIN_TYPES.issuperset(map(type, chain.from_iterable(items)))
