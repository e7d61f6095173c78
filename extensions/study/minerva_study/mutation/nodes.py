"""Nodes for mutations: new ones, and copies with another value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
    rescoped,
    walk,
)
from minerva_bus.launch.assignment import NodePath, with_value
from minerva_study.mutation.mutable import Targets
from minerva_study.mutation.naming import new_id
from minerva_study.mutation.values import drawn, one_of

Stream = np.random.Generator

FRESH: Final = 0.5
"""Probability with which a number with a default is drawn for a new node."""


def put(scene: Scene, place: NodePath, nodes: Sequence[Node]) -> Scene:
    """The string with these nodes instead of the one at a place; other nodes are shared."""
    # From the place outwards: only the nodes around it are made again.
    for above in place.upwards():
        around = above.parent
        siblings = (scene if around is None else scope_of(around.node)).nodes
        made = Scene((*siblings[: above.index], *nodes, *siblings[above.index + 1 :]))
        if around is None:
            return made
        nodes = (rescoped(around.node, made),)
    return scene


def scope_of(node: Node) -> Scene:
    """A node's scope; ε for a figure, which has none."""
    return EMPTY if isinstance(node, FigureNode) else node.scope


def ids_of(scene: Scene) -> set[str]:
    """The ids of all agents of a string."""
    return {node.id for opens, node in walk(scene) if opens and isinstance(node, AgentNode)}


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


def with_value_at(scene: Scene, path: tuple[int, ...], n: int, value: Value) -> Scene:
    """The string with another value of the nth parameter of the node at a path."""
    place: NodePath | None = None
    for depth, index in enumerate(path, 1):
        scope = scene if place is None else scope_of(place.node)
        place = NodePath(scope.nodes[index], index, place, depth)
    if place is None or value is place.node.values[n]:
        return scene
    return put(scene, place, [with_value(place.node, n, value)])
