"""Nodes for mutations: new ones, and copies with another value."""

from __future__ import annotations

from typing import Final

import numpy as np

from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.mutation.naming import new_id
from minerva_bus.grammar.mutation.places import NodePath, ids_of, put, scope_of
from minerva_bus.grammar.mutation.targets import Targets
from minerva_bus.grammar.mutation.values import drawn, one_of
from minerva_bus.grammar.scene import (
    AgentNode,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
)

Stream = np.random.Generator

FRESH: Final = 0.5
"""Probability with which a number with a default is drawn for a new node."""


def new_node(scene: Scene, targets: Targets, scope: Scene, without: Scene, chance: Stream) -> Node:
    """A node of a random symbol, around a scope if it can have one.

    Its id is new in the string, except for ids of `without`, which it replaces.
    """
    symbol = one_of(targets.symbols, chance)
    fields = targets.vocabulary.fields(symbol)
    values = tuple([_first_value(symbol, field, targets, chance) for field in fields.all])
    if symbol.startswith("P"):
        return FigureNode(symbol, fields.names, values)
    if symbol.startswith("T"):
        return TransformationNode(symbol, fields.names, values, scope)
    taken = (ids_of(scene) - ids_of(without)) | ids_of(scope)
    return AgentNode(symbol, new_id(symbol, taken), fields.names, values, scope)


def _first_value(symbol: str, field: Field, targets: Targets, chance: Stream) -> Value:
    domain = targets.domain(symbol, field.name)
    if field.default is not None:
        varies = domain is not None or field.type.kind == "real"
        if not varies or chance.random() >= FRESH:
            return field.default
    return drawn(field.type, domain, chance)


def with_value(node: Node, n: int, value: Value) -> Node:
    """The node with another value of its nth parameter."""
    values = (*node.values[:n], value, *node.values[n + 1 :])
    if isinstance(node, FigureNode):
        return FigureNode(node.symbol, node.names, values)
    if isinstance(node, TransformationNode):
        return TransformationNode(node.symbol, node.names, values, node.scope)
    return AgentNode(node.symbol, node.id, node.names, values, node.scope)


def with_value_at(scene: Scene, path: tuple[int, ...], n: int, value: Value) -> Scene:
    """The string with another value of the nth parameter of the node at a path."""
    place: NodePath | None = None
    for depth, index in enumerate(path, 1):
        scope = scene if place is None else scope_of(place.node)
        place = NodePath(scope.nodes[index], index, place, depth)
    if place is None or value is place.node.values[n]:
        return scene
    return put(scene, place, [with_value(place.node, n, value)])
