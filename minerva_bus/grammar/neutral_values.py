"""Agents at rest: their commands are reset to neutral values."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import cast

import numpy as np

from minerva_bus.grammar.column import Column, Rows
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import (
    AgentNode,
    Node,
    Piece,
    Scene,
    TransformationNode,
    Value,
    agents,
    rescoped,
)
from minerva_bus.grammar.symbols import AgentKind
from minerva_bus.grammar.traversal import of_pieces, rebuild

Kinds = Mapping[str, AgentKind]


def rested(scene: Scene, who: Collection[str], kinds: Kinds) -> Scene:
    """The string with the agents of these ids at rest; the same object if they already are.

    The attributes that a kind declares as `rest` become 0, false, "" or (); a string loses its
    transformations, so that its primitives remain without motion.
    """
    if not who or not any(kind.rest for kind in kinds.values()):
        return scene
    return of_pieces(scene, [node for piece in scene.pieces for node in _piece(piece, who, kinds)])


def _piece(piece: Piece, who: Collection[str], kinds: Kinds) -> tuple[Piece, ...]:
    if piece.ids is not None:
        return (_columns(piece, who, kinds),)
    # Nothing to do, so the piece remains the same object and is not sent again.
    if not any(agent.id in who and kinds[agent.symbol].rest for agent in agents(Scene((piece,)))):
        return (piece,)

    def leave(node: Node, scope: Scene) -> Scene | Node:
        node = rescoped(node, scope)
        selected = isinstance(node, AgentNode) and node.id in who
        return _agent(cast("AgentNode", node), kinds[node.symbol].rest) if selected else node

    return rebuild(Scene((piece,)), leave).pieces


def _agent(node: AgentNode, rest: Collection[str]) -> AgentNode:
    pairs = zip(node.names, node.values, strict=True)
    values = tuple([at_rest(value) if name in rest else value for name, value in pairs])
    return node if same_values(node.values, values) else replace(node, values=values)


def _columns(part: Columns, who: Collection[str], kinds: Kinds) -> Columns:
    rest = kinds[part.symbol].rest if part.ids is not None else ()
    if not rest or part.ids is None:
        return part
    rows = part.ids.rows_of(Ids.of(sorted(who)))
    # Ids that are not in these columns have the row -1.
    rows = np.sort(rows[rows >= 0])
    columns = [
        _still(column, rows) if name in rest else column
        for name, column in zip(part.names, part.columns, strict=True)
    ]
    return part.with_columns(columns)


def _still(column: Column, rows: Rows) -> Column:
    values = tuple(column.array[rows].tolist())
    still = tuple([at_rest(value) for value in values])
    # As for single agents: 0.0 == -0.0, but they print differently.
    return column if same_values(still, values) else column.put(rows, Column.of(still).array)


def at_rest(value: Value) -> Value:
    """The neutral value for an attribute with this value."""
    if isinstance(value, Scene):
        still = rebuild(value, _without_motion)
        return value if still == value else still
    # 0, 0.0, False, "" or ().
    return type(value)()  # pyright: ignore[reportCallIssue]


def _without_motion(node: Node, scope: Scene) -> Scene | Node:
    return scope if isinstance(node, TransformationNode) else rescoped(node, scope)
