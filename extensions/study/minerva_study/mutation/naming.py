"""Unique ids for agents that a mutation adds to a string."""

from __future__ import annotations

import re
from itertools import count

from minerva_bus.grammar.scene import AgentNode, Node, Scene, rebuild, rescoped

_COPY = re.compile(r"-[0-9]+$")


def copy_id(name: str, taken: set[str]) -> str:
    """The id itself if it is free, otherwise the first free one of `name-2`, `name-3`, ..."""
    if name not in taken:
        return name
    # A copy of `fox-2` is `fox-3`, not `fox-2-2`.
    stem = _COPY.sub("", name) or name
    return next(free for n in count(2) if (free := f"{stem}-{n}") not in taken)


def new_id(symbol: str, taken: set[str]) -> str:
    """An id for a new agent of a kind: `fox1`, `fox2`, ... of AFox."""
    stem = symbol[1:].lower() or "a"
    return next(free for n in count(1) if (free := f"{stem}{n}") not in taken)


def with_own_ids(nodes: Scene, taken: set[str]) -> Scene:
    """The string with a new id for each agent whose id is taken; adds its ids to `taken`."""

    def leave(node: Node, scope: Scene) -> Node:
        if not isinstance(node, AgentNode):
            return rescoped(node, scope)
        name = copy_id(node.id, taken)
        taken.add(name)
        if name == node.id:
            return rescoped(node, scope)
        return AgentNode(node.symbol, name, node.names, node.values, scope)

    return rebuild(nodes, leave)
