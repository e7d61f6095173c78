"""Strings of L(M) as immutable values (Table 1).

A `Scene` is a concatenation of nodes, one class for each alternative of rule 3:

    FigureNode           p           rule 6
    TransformationNode   t(OBJECTS)  rule 5
    AgentNode            a(OBJECTS)  rule 4

A string consists of *pieces*. A piece is a node, or a `Columns` (grammar/columns.py) that
represents many nodes of one shape. Both have `symbol`, `count`, `ids`, `still` and `nodes()`, so
most code does not distinguish them. A *fragment* is a `Scene`, too. The second half walks over
strings from left to right, rewrites them from the leaves up, and fills *slots*: agents by name
only, which are replaced by other strings. Nothing here recurses: only memory limits the depth of a
string.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import is_
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeAlias, cast, overload

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError

if TYPE_CHECKING:
    from minerva_bus.grammar.columns import Columns
    from minerva_bus.grammar.types import Quantity


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
        from minerva_bus.grammar.text_and_digest import text

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
            from minerva_bus.grammar.text_and_digest import scene_digest

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
        if not isinstance(other, (FigureNode, TransformationNode, AgentNode)):
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
        if isinstance(piece, (FigureNode, TransformationNode, AgentNode)):
            pieces.append(piece)
        elif piece.ids is not None:
            return list(reversed(scene.nodes))
    return pieces


def walk(scene: Scene) -> Iterator[tuple[bool, Node]]:
    """(True, node) at the start of each node and (False, node) at the end of its scope, in order.

    A figure has no scope, so it has a start only.
    """
    stack = [iter(scene.nodes)]
    open_nodes: list[Node] = []
    while stack:
        node = next(stack[-1], None)
        if node is None:
            stack.pop()
            if open_nodes:
                yield False, open_nodes.pop()
            continue
        yield True, node
        if not isinstance(node, FigureNode):
            open_nodes.append(node)
            stack.append(iter(node.scope.nodes))


def rebuild(
    scene: Scene, leave: Callable[[Node, Scene], Scene | Node], whole: Container[int] = ()
) -> Scene:
    """Rewrite a string from the leaves up: `leave(node, its rewritten scope)` replaces each node.

    If `leave` returns the same node, the original is shared. Nodes whose `id()` is in `whole` are
    passed to `leave` with their scope unchanged.
    """
    # A stack of its own: strings may be nested more deeply than Python recurses.
    nodes = iter(scene.nodes)
    made: list[Node] = []
    opened: list[tuple[TransformationNode | AgentNode, Iterator[Node], list[Node]]] = []
    while True:
        # `made` has the new nodes of the current scope; `opened` the nodes around it, with the
        # siblings that are still to come and those that are done.
        for node in nodes:
            if isinstance(node, FigureNode):
                new = leave(node, EMPTY)
            elif not node.scope.pieces or id(node) in whole:
                new = leave(node, node.scope)
            else:
                opened.append((node, nodes, made))
                nodes, made = iter(node.scope.nodes), []
                break
            made += new.nodes if isinstance(new, Scene) else (new,)
        else:
            if not opened:
                return shared(scene, made)
            done, nodes, outer = opened.pop()
            new = leave(done, shared(done.scope, made))
            outer += new.nodes if isinstance(new, Scene) else (new,)
            made = outer


def shared(old: Scene, nodes: list[Node]) -> Scene:
    """The string of these nodes; the old string if they are the same objects as its nodes."""
    former = old.nodes
    if len(nodes) == len(former) and all(map(is_, nodes, former)):
        return old
    return Scene(tuple(nodes)) if nodes else EMPTY


def of_pieces(old: Scene, pieces: Sequence[Piece]) -> Scene:
    """As `shared`, for pieces: columns are compared as objects, not by their rows."""
    if len(pieces) == len(old.pieces) and all(map(is_, pieces, old.pieces)):
        return old
    return Scene(tuple(pieces)) if pieces else EMPTY


def kind_counts(*pieces: Piece) -> Counter[str]:
    """Number of agents of each kind in pieces of a string, including agents in scopes."""
    counts: Counter[str] = Counter()
    for piece in pieces:
        if piece.ids is not None:
            counts[piece.symbol] += piece.count
        elif not piece.still:
            counts.update(agent.symbol for agent in agents(Scene((piece,))))
    return counts


def identities(scene: Scene) -> frozenset[int]:
    """The `id()` of each node of a string, to recognize the nodes in another string."""
    return frozenset(map(id, scene.nodes))


def fill(skeleton: Scene, parts: Mapping[str, Scene]) -> Scene:
    """The skeleton with each slot replaced by its fragment, or by ε if there is none."""
    made: list[Piece] = []
    for piece in skeleton.pieces:
        if isinstance(piece, AgentNode):
            made += parts.get(piece.id, EMPTY).pieces
        # Columns of agents cannot be slots, which are single nodes.
        elif piece.still or piece.ids is not None:
            made.append(piece)
        else:
            made += fill_slots(Scene((piece,)), lambda slot: parts.get(slot.id, EMPTY)).pieces
    return of_pieces(skeleton, made)


def fill_slots(scene: Scene, part: Callable[[AgentNode], Scene]) -> Scene:
    """Replace the outermost agents; unchanged parts are shared."""
    # One list of new nodes for each transformation that is open.
    results: list[list[Node]] = [[]]
    inside = 0
    for opens, node in walk(scene):
        if isinstance(node, AgentNode):
            inside += 1 if opens else -1
            if opens and inside == 1:
                results[-1].extend(part(node).nodes)
        # Within an outermost agent, which is replaced as a whole.
        elif inside:
            continue
        elif isinstance(node, FigureNode):
            results[-1].append(node)
        elif opens:
            results.append([])
        else:
            scope = shared(node.scope, results.pop())
            same = scope is node.scope
            results[-1].append(
                node if same else TransformationNode(node.symbol, node.names, node.values, scope)
            )
    return shared(scene, results[0])
