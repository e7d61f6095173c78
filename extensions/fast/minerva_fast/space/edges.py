"""Graphs: edges between nodes; the nodes are the cells of a space, usually in one row."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.types import Reals
from minerva_fast.space.draws import Draws, integers
from minerva_fast.space.kernels import kernel

NO_NODE = "a node is not in the graph, as -1 of `random_neighbour` is; test it before"
NO_EDGE = "a node has no edge with this number; they are from 0 to `degree` - 1"


class Edges(NamedTuple):
    """What a rule sees of a matrix of edges; see `degree`, `neighbour`, `random_neighbour`, `edge`.

    The neighbours of node n are `ends[starts[n]:starts[n + 1]]`, in ascending order.
    """

    starts: NDArray[np.int64]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, pairs: ArrayLike, *, directed: bool = False) -> Reals:
        """The matrix of a graph, shape (2, edges): from a node, to a node, sorted; each edge once.

        Args:
            pairs: nodes from 0 on, shape (pairs, 2).
            directed: whether a pair is an edge from its first node to its second one only;
                otherwise the matrix has both directions.

        Raises:
            MisuseError: these are not pairs of nodes.

        """
        nodes = np.asarray(pairs)
        if nodes.size == 0:
            nodes = np.empty((0, 2), np.int64)
        if nodes.ndim != 2 or nodes.shape[1] != 2 or nodes.dtype.kind not in "iu":
            raise MisuseError(
                f"Edges.of expects pairs of nodes, ints of shape (pairs, 2), not {nodes.dtype}"
                f" of shape {nodes.shape}"
            )
        if nodes.size and nodes.min() < 0:
            raise MisuseError(f"Edges.of: nodes are numbers from 0, not {nodes.min()}")
        both = nodes if directed else np.concatenate((nodes, nodes[:, ::-1]))
        matrix = np.ascontiguousarray(np.unique(both, axis=0).T, np.float64)
        matrix.flags.writeable = False
        return matrix


def opened_edges(name: str, matrix: NDArray[Any], nodes: int) -> Edges:
    """The edges of a matrix, in a space with this number of nodes. Raises MisuseError."""
    if matrix.shape[0] != len(Edges._fields):
        raise MisuseError(
            f"{name} must be the matrix of a graph, with 2 rows, not {len(matrix)}; use Edges.of"
        )
    begins, ends = matrix.astype(np.int64)
    if begins.size and (matrix.min() < 0 or matrix.max() >= nodes):
        raise MisuseError(
            f"{name} has edges between nodes from {matrix.min():.0f} to {matrix.max():.0f}, but the"
            f" cells of the space are 0 to {nodes - 1}; set `width` to the number of nodes"
        )
    if np.any(begins[1:] < begins[:-1]):
        raise MisuseError(f"the edges of {name} must be sorted by their first node; use Edges.of")
    starts = np.zeros(nodes + 1, np.int64)
    np.cumsum(np.bincount(begins, minlength=nodes), out=starts[1:])
    return Edges(starts, ends)


@kernel
def degree(edges: Edges, node: int) -> int:
    """The number of edges from a node."""
    if not 0 <= node < len(edges.starts) - 1:
        raise IndexError(NO_NODE)
    return edges.starts[node + 1] - edges.starts[node]


@kernel
def edge(edges: Edges, node: int, k: int) -> int:
    """The column of the k-th edge from a node, at which other matrices have numbers for it."""
    if not 0 <= k < degree(edges, node):
        raise IndexError(NO_EDGE)
    return edges.starts[node] + k


@kernel
def neighbour(edges: Edges, node: int, k: int) -> int:
    """The node at the other end of the k-th edge from a node."""
    return edges.ends[edge(edges, node, k)]


@kernel
def random_neighbour(edges: Edges, node: int, draws: Draws) -> int:
    """The node at the other end of a random edge from a node; -1 if it has none."""
    count = degree(edges, node)
    if not count:
        return -1
    return neighbour(edges, node, integers(draws, 0, count))
