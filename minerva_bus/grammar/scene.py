"""Strings of L(M) as immutable values (Table 1).

A `Scene` is a concatenation of nodes, one class for each alternative of rule 3:

    FigureNode           p           rule 6
    TransformationNode   t(OBJECTS)  rule 5
    AgentNode            a(OBJECTS)  rule 4

A string consists of *pieces*. A piece is a node, or a `Columns` (grammar/columns.py) that
represents many nodes of one shape. Both have `symbol`, `count`, `ids`, `still` and `nodes()`, so
most code does not distinguish them. A *fragment* is a `Scene`, too. Nothing here recurses: only
memory limits the depth of a string. traversal.py has functions that walk and rewrite strings.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeAlias, cast, overload

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError

if TYPE_CHECKING:
    from minerva_bus.grammar.columns import Columns
    from minerva_bus.grammar.measures import Quantity

Array: TypeAlias = NDArray[np.int16] | NDArray[np.float64]
Value: TypeAlias = "bool | int | float | str | Quantity | tuple[Value, ...] | Array | Scene"
Node: TypeAlias = "FigureNode | TransformationNode | AgentNode"
Piece: TypeAlias = "FigureNode | TransformationNode | AgentNode | Columns"

# Bounded, because searching for ids takes time and memory for the longest of them.
AGENT_ID: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_:-]{0,1023}")

DEPTH: Final = 32
"""Levels of lists and strings within a value."""

MATRIX_CELLS: Final = 32_000_000
"""Cells of the largest matrix."""


class Digested:
    """Caches its digest, whether it contains no agents, and the declaration that it fits."""

    __slots__ = ("_digest", "_fits", "_still")


class Scene(Digested):
    """A string w ∈ L(M): a concatenation of nodes. `EMPTY` is ε. Immutable.

    `pieces` is the representation: nodes, and `Columns` for many nodes. `nodes` is the content.
    `a + b` is the concatenation, `len` the number of nodes, `str` the text, and equal strings have
    equal digests.

    Example:
        >>> print(parse("PWall") + parse("PFloor"))
        PWall · PFloor

    """

    __slots__ = ("_nodes", "pieces")

    pieces: tuple[Piece, ...]
    _nodes: tuple[Node, ...] | None

    def __init__(self, pieces: tuple[Piece, ...] = ()) -> None:
        # Past `__setattr__`, which rejects changes.
        object.__setattr__(self, "pieces", pieces)
        object.__setattr__(self, "_nodes", None)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a string is immutable; {name} cannot be set")

    @property
    def nodes(self) -> tuple[Node, ...]:
        """All nodes, including those in columns."""
        if self._nodes is not None:
            return self._nodes
        nodes: Any = self.pieces
        if not _NODES.issuperset(map(type, nodes)):
            nodes = tuple([node for piece in self.pieces for node in piece.nodes()])
        object.__setattr__(self, "_nodes", nodes)
        return nodes

    def __add__(self, other: object) -> Scene:
        if not isinstance(other, Scene):
            return NotImplemented
        if not self.pieces:
            return other
        return Scene(self.pieces + other.pieces) if other.pieces else self

    def __iter__(self) -> Iterator[Node]:
        return iter(self.nodes)

    def __len__(self) -> int:
        return len(self.nodes)

    def __bool__(self) -> bool:
        return bool(self.pieces)

    def __reduce__(self) -> tuple[type[Scene], tuple[tuple[Piece, ...]]]:
        # Pickling would otherwise set attributes, which `__setattr__` rejects.
        return Scene, (self.pieces,)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        # By digest, because a comparison of nodes would recurse into scopes, and digests are
        # cached.
        return self.pieces is other.pieces or self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __str__(self) -> str:
        if not self.pieces:  # `python -OO` shows defaults of nodes before there is a printer.
            return ""
        # Imported here, because the printer imports this module.
        from minerva_bus.grammar.printer import text

        return text(self)

    def __repr__(self) -> str:
        shown = str(self)
        return f"Scene({shown if len(shown) < 200 else shown[:199] + '…'})"

    @property
    def digest(self) -> bytes:
        """16 bytes, equal for two strings exactly if they print the same."""
        known: bytes | None = getattr(self, "_digest", None)
        if known is None:
            # Imported here, because the digest imports this module.
            from minerva_bus.grammar.digest import scene_digest

            known = scene_digest(self)
            object.__setattr__(self, "_digest", known)
        return known


EMPTY: Final = Scene()


def checked_string(value: Any) -> Scene:
    """A string that a user's code has passed. Raises MisuseError for anything else."""
    if not isinstance(value, Scene):
        raise MisuseError(
            f"expected a string of a world, not {value!r:.60}; an agent has its own as .string, and"
            " parse(...) reads a text"
        )
    return value


class _SingleNode(Digested):
    """Base of nodes. A piece of a string is one node, or `Columns` with the same interface.

    Nodes are equal when they print the same, as strings are.
    """

    __slots__ = ()

    count: ClassVar[int] = 1
    """Number of nodes that a piece represents."""

    ids: ClassVar[None] = None
    """Ids of agents held in columns; None for a node, and for columns of figures."""

    def nodes(self) -> tuple[Node]:
        """The nodes that a piece represents."""
        return (cast("Node", self),)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, FigureNode | TransformationNode | AgentNode):
            return NotImplemented
        return self is other or scene_of(cast("Node", self)) == scene_of(other)

    def __hash__(self) -> int:
        return hash(scene_of(cast("Node", self)))


@dataclass(frozen=True, slots=True, eq=False)
class FigureNode(_SingleNode):
    """One occurrence of a primitive p ∈ P with its parameters."""

    symbol: str
    names: tuple[str, ...] = ()
    values: tuple[Value, ...] = ()

    still: ClassVar[bool] = True
    """Whether a piece contains no agents."""

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Parameters by name."""
        return dict(zip(self.names, self.values, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class TransformationNode(_SingleNode):
    """One occurrence of t(OBJECTS), t ∈ T."""

    symbol: str
    names: tuple[str, ...] = ()
    values: tuple[Value, ...] = ()
    scope: Scene = EMPTY

    @property
    def parameters(self) -> Mapping[str, Any]:
        """Parameters by name."""
        return dict(zip(self.names, self.values, strict=True))

    @property
    def still(self) -> bool:
        """Whether there is no agent in the scope; cached, because frames need it repeatedly."""
        known: bool | None = getattr(self, "_still", None)
        if known is None:
            known = next(agents(self.scope), None) is None
            object.__setattr__(self, "_still", known)
        return known


@dataclass(frozen=True, slots=True, eq=False)
class AgentNode(_SingleNode):
    """One agent a(OBJECTS): its kind's symbol, its id and its state st ∈ ST."""

    symbol: str
    id: str
    names: tuple[str, ...] = ()
    values: tuple[Value, ...] = ()
    scope: Scene = EMPTY

    still: ClassVar[bool] = False

    @property
    def state(self) -> Mapping[str, Any]:
        """Attributes by name."""
        return dict(zip(self.names, self.values, strict=True))

    def fitted(self, fields: object) -> AgentNode:
        """The same node, whose values have just been fitted to these `Fields`."""
        object.__setattr__(self, "_fits", fields)
        return self

    def fits(self, fields: object) -> bool:
        """Whether its values certainly fit these very `Fields`, since they were fitted to them."""
        return getattr(self, "_fits", None) is fields


Scoped: TypeAlias = TransformationNode | AgentNode
"""Nodes that have a scope."""

_NODES: Final = frozenset((FigureNode, TransformationNode, AgentNode))


def scene_of(*nodes: Node) -> Scene:
    """The concatenation of the nodes."""
    return Scene(nodes)


@overload
def with_scope(node: AgentNode, scope: Scene) -> AgentNode: ...
@overload
def with_scope(node: TransformationNode, scope: Scene) -> TransformationNode: ...
@overload
def with_scope(node: Scoped, scope: Scene) -> Scoped: ...
def with_scope(node: Scoped, scope: Scene) -> Scoped:
    """The node with another scope; the same object if nothing changes."""
    # Empty scopes may be different objects.
    if scope is node.scope or (not scope.pieces and not node.scope.pieces):
        return node
    if isinstance(node, AgentNode):
        return AgentNode(node.symbol, node.id, node.names, node.values, scope)
    return TransformationNode(node.symbol, node.names, node.values, scope)


def rescoped(node: Node, scope: Scene) -> Node:
    """The node with another scope; a figure has none and is returned as it is."""
    if isinstance(node, FigureNode) or scope is node.scope:
        return node
    return with_scope(node, scope)


def agents(scene: Scene, passed_over: Container[int] = ()) -> Iterator[AgentNode]:
    """All agents of a string, including those within others, from left to right.

    Nodes whose `id()` is in `passed_over` are skipped with their scopes.
    """
    stack = _perhaps_agents(scene)
    while stack:
        node = stack.pop()
        if isinstance(node, FigureNode) or id(node) in passed_over:
            continue
        if isinstance(node, AgentNode):
            yield node
        stack += _perhaps_agents(node.scope)


def _perhaps_agents(scene: Scene) -> list[Node]:
    """The nodes that are agents or may contain some, from right to left."""
    pieces: list[Node] = []
    for piece in reversed(scene.pieces):
        if isinstance(piece, FigureNode | TransformationNode | AgentNode):
            pieces.append(piece)
        elif piece.ids is not None:
            return list(reversed(scene.nodes))
    return pieces
