"""Hypothesis strategies for values, and for any string that the grammar allows."""

from __future__ import annotations

import string
from collections.abc import Callable
from functools import cache
from itertools import count
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy
from numpy.typing import NDArray

from minerva_bus.grammar.measures import Quantity
from minerva_bus.grammar.scene import (
    AgentNode,
    Array,
    FigureNode,
    Node,
    Scene,
    TransformationNode,
    Value,
    rescoped,
)
from minerva_bus.grammar.traversal import rebuild

# Hypothesis validates each strategy once, with its parts. A strategy that depends on what has been
# drawn costs less if its parts are the same objects each time, which `cache` gives.

LETTERS = string.ascii_letters + string.digits + "_"
UNITS = ("m", "km", "cm", "mm", "deg", "rad", "s", "m/s", "km/h", "Hz")


@cache
def names() -> SearchStrategy[str]:
    """Names of parameters, attributes and data."""
    return st.text(LETTERS, min_size=1, max_size=8).filter(lambda name: not name[0].isdigit())


@cache
def symbols(letter: str) -> SearchStrategy[str]:
    """Symbols of one alphabet: P, T, A, or e for event types."""
    return st.text(LETTERS, max_size=6).map(lambda rest: letter + rest)


@cache
def ids() -> SearchStrategy[str]:
    """Ids of agents."""
    first = st.sampled_from(LETTERS)
    # Any form that the grammar allows, including those of newborns (`a:3`) and copies (`a:7-2`).
    return st.builds(str.__add__, first, st.text(LETTERS + ":-", max_size=8))


@cache
def given_ids() -> SearchStrategy[str]:
    """Ids as written in world files; only those of newborns and copies contain : and -."""
    return st.text(LETTERS, min_size=1, max_size=6)


@cache
def integers() -> SearchStrategy[int]:
    """Whole numbers of 64 bits."""
    return st.integers(-(1 << 63), (1 << 63) - 1)


@cache
def reals() -> SearchStrategy[float]:
    """Finite numbers, including -0.0 and denormal ones."""
    return st.floats(allow_nan=False, allow_infinity=False)


@cache
def texts() -> SearchStrategy[str]:
    """Texts of Unicode characters, including quotes, backslashes and control characters."""
    # Surrogates cannot be encoded in UTF-8.
    return st.text(st.characters(exclude_categories=("Cs",)), max_size=12)


@cache
def matrices() -> SearchStrategy[Array]:
    """Read-only matrices of both types, also without rows or columns."""
    return st.one_of(matrices_of(np.int16), matrices_of(np.float64))


@cache
def matrices_of(dtype: type[np.int16] | type[np.float64]) -> SearchStrategy[Array]:
    """Read-only matrices of one type; few different values, so that equal ones repeat."""
    return _matrix(dtype)


@st.composite
def _matrix(draw: DrawFn, dtype: type[np.int16] | type[np.float64]) -> Array:
    rows, columns = draw(st.integers(0, 4)), draw(st.integers(0, 4))
    cells: SearchStrategy[Any] = st.integers(-32768, 32767) if dtype is np.int16 else reals()
    few = draw(st.lists(cells | st.sampled_from([0.0, -0.0]), min_size=1, max_size=3))
    drawn = draw(st.lists(st.sampled_from(few), min_size=rows * columns, max_size=rows * columns))
    matrix: NDArray[Any] = np.array(drawn, dtype).reshape(rows, columns)
    matrix.flags.writeable = False
    return matrix


@cache
def quantities() -> SearchStrategy[Quantity]:
    """Numbers with a unit, as in a text, before a vocabulary converts them."""
    return st.builds(Quantity, reals(), st.sampled_from(UNITS))


@cache
def values(depth: int = 2) -> SearchStrategy[Value]:
    """Any value that a text may hold, with lists and strings nested up to a depth."""
    plain: SearchStrategy[Any] = st.one_of(
        st.booleans(), integers(), reals(), texts(), matrices(), quantities()
    )
    if depth == 0:
        return plain
    inner = values(depth - 1)
    return st.one_of(plain, st.lists(inner, max_size=3).map(tuple), scenes(depth - 1, max_leaves=3))


@cache
def scenes(depth: int = 1, max_leaves: int = 12) -> SearchStrategy[Scene]:
    """Any string of L(M): arbitrary symbols, parameters and values, unique ids of agents."""
    bare: SearchStrategy[Any] = st.dictionaries(names(), values(depth), max_size=2)
    return grown(
        st.builds(figure_node, symbols("P"), bare),
        lambda scopes: st.one_of(
            st.builds(transformation_node, symbols("T"), bare, scopes),
            st.builds(agent_node, symbols("A"), ids(), bare, scopes),
        ),
        max_leaves,
    )


def grown(
    leaves: SearchStrategy[Node],
    extend: Callable[[SearchStrategy[Scene]], SearchStrategy[Node]],
    max_leaves: int,
) -> SearchStrategy[Scene]:
    """Strings of `leaves`, and of the results of `extend` for the strings drawn so far."""

    def concatenated(nodes: SearchStrategy[Node]) -> SearchStrategy[Scene]:
        return st.lists(nodes, max_size=4).map(lambda drawn: Scene(tuple(drawn)))

    grown = st.recursive(
        concatenated(leaves),
        lambda scopes: concatenated(leaves | extend(scopes)),
        max_leaves=max_leaves,
    )
    return grown.map(with_unique_ids)


def figure_node(symbol: str, data: dict[str, Value]) -> Node:
    """A figure with its parameters."""
    return FigureNode(symbol, tuple(data), tuple(data.values()))


def transformation_node(symbol: str, data: dict[str, Value], scope: Scene) -> Node:
    """A transformation around its scope."""
    return TransformationNode(symbol, tuple(data), tuple(data.values()), scope)


def agent_node(symbol: str, name: str, data: dict[str, Value], scope: Scene) -> Node:
    """An agent around its scope."""
    return AgentNode(symbol, name, tuple(data), tuple(data.values()), scope)


def with_unique_ids(scene: Scene) -> Scene:
    """The same string with new ids for the second and later agents that share an id."""
    taken: set[str] = set()

    def leave(node: Node, scope: Scene) -> Node:
        if not isinstance(node, AgentNode):
            return rescoped(node, scope)
        name = next(
            name for n in count(1) if (name := node.id if n == 1 else f"{node.id}_{n}") not in taken
        )
        taken.add(name)
        return AgentNode(node.symbol, name, node.names, node.values, scope)

    return rebuild(scene, leave)
