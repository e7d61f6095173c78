"""Balancing: borders between regions that give each about the same number of agents.

They are a function of the string, so each coordinator computes the same ones, and its successor.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeGuard

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import AgentNode, Piece, Scene, agents
from minerva_bus.regions.partition import ByPosition, Partition, is_coordinate
from minerva_bus.regions.tree import ByTree, Split

_BORDER: Final = np.dtype("<f8")


def is_due(partition: Partition | None, frame: int) -> TypeGuard[ByPosition | ByTree]:
    """Whether borders move before a frame."""
    by_position = isinstance(partition, ByPosition | ByTree)
    return by_position and partition.balance > 0 and frame > 0 and frame % partition.balance == 0


def balanced(partition: ByPosition | ByTree, scene: Scene) -> tuple[float, ...]:
    """The borders of a partition of this shape for a string.

    They are those of the partition if no agent of the string has the attributes.
    """
    names = partition.attributes
    points = np.concatenate([np.empty((0, len(names))), *_points(scene.pieces, names)])
    if not len(points):
        return partition.borders
    if isinstance(partition, ByTree):
        return tuple(_of_split(partition.root, points, names))
    made = [
        border
        for column, borders in enumerate((partition.across, partition.down)[: len(names)])
        for border in _quantiles(points[:, column], [1] * (len(borders) + 1))
    ]
    return tuple(made)


def packed_borders(borders: Sequence[float]) -> bytes:
    """Borders between regions as float64, little-endian."""
    return np.array(borders, _BORDER).tobytes()


def borders_of(partition: Partition) -> bytes:
    """The borders of a partition, packed; none if it has no borders."""
    by_position = isinstance(partition, ByPosition | ByTree)
    return packed_borders(partition.borders) if by_position else b""


def moved(partition: Partition, borders: bytes) -> Partition:
    """A partition with these borders; none: unchanged. Raises ProtocolError."""
    if not borders:
        return partition
    try:
        numbers: list[float] = np.frombuffer(borders, _BORDER).tolist()
        if isinstance(partition, ByPosition | ByTree):
            return partition.moved(numbers)
        problem = "these regions have no borders"
    except ValueError as error:
        problem = str(error)
    raise ProtocolError(f"outside: borders: {problem}")


def _of_split(split: Split, points: NDArray[np.float64], names: Sequence[str]) -> list[float]:
    """The borders of a split and its parts, in their order."""
    values = points[:, names.index(split.name)]
    parts = [(split.below, 1), (split.above, 1)]
    leaves = [leaf if part is None else part.leaves for part, leaf in parts]
    (at,) = _quantiles(values, leaves) if len(values) else [split.at]
    borders = [at]
    for part, inside in ((split.below, values < at), (split.above, values >= at)):
        borders += [] if part is None else _of_split(part, points[inside], names)
    return borders


def _quantiles(values: NDArray[np.float64], shares: Sequence[int]) -> list[float]:
    """Values that divide others into parts of these shares, between each part and the next."""
    ordered = np.sort(values)
    ends = np.cumsum(shares)[:-1] * len(ordered) // sum(shares)
    return [float(ordered[min(end, len(ordered) - 1)]) for end in ends.tolist()]


def _points(pieces: Sequence[Piece], names: Sequence[str]) -> list[NDArray[np.float64]]:
    """The attributes of the agents in each piece, shape (agents, names), as far as they are finite.

    In a transformation only the first agent counts, because the others move with it.
    """
    made: list[NDArray[np.float64]] = []
    nodes: list[list[float]] = []
    for piece in pieces:
        if isinstance(piece, Columns):
            if piece.ids is not None and {*names} <= {*piece.names}:
                columns = [piece.column(name) for name in names]
                if all(column.dtype.kind in "if" for column in columns):
                    made.append(np.stack(columns, axis=1).astype(np.float64))
            continue
        first = None if piece.still else next(agents(Scene((piece,))), None)
        values = None if first is None else _values(first, names)
        nodes += [] if values is None else [values]
    made += [np.array(nodes, np.float64)] if nodes else []
    return [points[np.isfinite(points).all(axis=1)] for points in made]


def _values(agent: AgentNode, names: Sequence[str]) -> list[float] | None:
    values = [agent.state.get(name) for name in names]
    numbers = [float(value) for value in values if is_coordinate(value)]
    return numbers if len(numbers) == len(values) else None
