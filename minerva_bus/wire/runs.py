"""Runs of flat nodes of one symbol, which are read together.

Most nodes of a large string stand beside others of their kind. The checks of a node in Python cost
more than everything else, so those of a run are done by calls for all of its nodes.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable
from itertools import repeat
from operator import itemgetter
from typing import Any, Final

from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.scene import (
    AGENT_ID,
    EMPTY,
    AgentNode,
    FigureNode,
    Node,
    TransformationNode,
)

RUN: Final = 8
"""Nodes from which on a run is read together."""

_IDS: Final = re.compile(rf"(?:{AGENT_ID.pattern}+\n)*+")


def end_of_run(flat: list[Any], begin: int, most: int) -> int:
    """The end of the run of nodes without scopes that begins there, of at most `most` nodes."""
    first, end = flat[begin], min(len(flat), begin + most)
    if end - begin < RUN or first.__class__ is not list or not first:
        return begin
    # Columns begin with their number of rows.
    if first[0].__class__ is not str or not _is_like(first, first):
        return begin
    for place in range(begin + 1, end):
        if not _is_like(flat[place], first):
            return place if place - begin >= RUN else begin
    return end


def _is_like(node: Any, first: Any) -> bool:
    """Whether a node has the symbol of the first one, as many items, and no scope."""
    return (
        node.__class__ is list
        and len(node) == len(first) > 1
        and node[0] == first[0]
        # A figure ends with its values, which are never 0.
        and (node[-1] == 0 or len(node) == 2)
    )


def nodes_of(run: list[list[Any]], fields: Fields, known: Container[str]) -> list[Node]:
    """The nodes of a run, whose values have these fields and whose ids are not `known`.

    Empty if any of them needs the checks for single nodes, or would fail them.
    """
    symbol, names = run[0][0], fields.names
    is_agent = symbol[:1] == "A"
    values = _values(list(map(itemgetter(2 if is_agent else 1), run)), fields)
    if values is None or (len(run[0]) > 2 and set(map(type, map(itemgetter(-1), run))) != {int}):
        return []
    if not is_agent:
        if symbol[:1] == "P":
            return list(map(FigureNode, repeat(symbol), repeat(names), values))
        return list(map(TransformationNode, repeat(symbol), repeat(names), values))
    ids = list(map(itemgetter(1), run))
    if not _are_new(ids, known):
        return []
    return list(map(AgentNode, repeat(symbol), ids, repeat(names), values, repeat(EMPTY)))


def _values(plain: list[Any], fields: Fields) -> Iterable[tuple[Any, ...]] | None:
    """The values of each node if they are as declared, otherwise None."""
    if set(map(type, plain)) != {list} or set(map(len, plain)) != {len(fields.names)}:
        return None
    return map(tuple, plain) if fields.are_final(zip(*plain, strict=True)) else None


def _are_new(ids: list[Any], known: Container[str]) -> bool:
    """Whether these are valid ids that differ from each other and from the known ones."""
    if set(map(type, ids)) != {str} or len(set(ids)) < len(ids):
        return False
    if any(map(known.__contains__, ids)):
        return False
    lines = "\n".join(ids) + "\n"
    return lines.count("\n") == len(ids) and _IDS.fullmatch(lines) is not None
