"""Where the agents of a string are, and the colours of its rasters.

Positions of agents are derived from the names of their attributes:

    x, y                        metres
    row, column, cell, x0, y0   cells: x = x0 + row · cell, y = y0 + column · cell (cell defaults
                                to 1, x0 and y0 to 0)

The heading is `angle` or `heading` in degrees, or the direction of `vx` and `vy`. Kinds without
such attributes have no position. Transformations around an agent move it by their motions.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.appearance import Motion, Raster
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Piece,
    Scene,
    TransformationNode,
    fill_slots,
    walk,
)
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.plane import after
from minerva_bus.semantics.poses import Pose

SHOWN: Final = 500
"""Agents of a kind that other tools are shown; of a larger kind, every n-th agent."""

Numbers = NDArray[np.float64]
_Get = Callable[[str, float], Numbers]

_NUMERIC: Final = frozenset(("real", "int"))
_ORIGIN: Final = Pose()
_PLANE: Final = frozenset(("x", "y"))
_GRID: Final = frozenset(("row", "column"))


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Positions of agents of one kind: n ids, x and y in metres, angle in degrees, each (n,)."""

    kind: str
    ids: Sequence[str]
    x: Numbers
    y: Numbers
    angle: Numbers

    def of(self, wanted: Container[str]) -> Iterator[tuple[str, float, float, float]]:
        """Id, x, y and angle of the agents with these ids."""
        rows = zip(self.ids, self.x.tolist(), self.y.tolist(), self.angle.tolist(), strict=True)
        return (row for row in rows if row[0] in wanted)


def placed_kinds(vocabulary: Vocabulary) -> dict[str, frozenset[str]]:
    """Kinds whose agents have positions, with their numeric attributes."""
    numbers = {
        kind.name: frozenset([f.name for f in kind.fields.all if f.type.kind in _NUMERIC])
        for kind in vocabulary.kinds.values()
    }
    return {kind: names for kind, names in numbers.items() if names >= _PLANE or names >= _GRID}


class Surveyor:
    """Finds the positions of agents, about `most` of each kind (0: all).

    Of a population in columns every n-th agent is taken, so the selection is stable over time.
    """

    def __init__(self, vocabulary: Vocabulary, most: int = 0) -> None:
        self.placed = placed_kinds(vocabulary)
        self._vocabulary = vocabulary
        self._most = most

    def places(self, scene: Scene) -> dict[str, Positions]:
        """Positions of agents by kind."""
        parts: dict[str, list[Positions]] = {}
        for part in self._all_places(scene):
            parts.setdefault(part.kind, []).append(part)
        return {kind: _together(kind, of_kind) for kind, of_kind in sorted(parts.items())}

    def _all_places(self, scene: Scene) -> Iterator[Positions]:
        nodes: list[Piece] = []
        for piece in scene.pieces:
            if piece.ids is not None:
                if piece.symbol in self.placed:
                    # The nodes before the columns are first, so that agents
                    # stay in the order of the string.
                    yield from _of_nodes(nodes, self._vocabulary, self.placed)
                    yield _of_columns(piece, self.placed[piece.symbol], self._most)
                    nodes = []
            elif not piece.still:
                nodes.append(piece)
        yield from _of_nodes(nodes, self._vocabulary, self.placed)


def _of_columns(piece: Columns, names: frozenset[str], most: int) -> Positions:
    # Rounded up, so that at most this many are taken.
    step = -(-piece.count // most) if most else 1
    sample = piece.take(slice(0, None, step)) if step > 1 else piece

    def get(name: str, default: float) -> Numbers:
        known = name in names
        return sample.column(name).astype(np.float64) if known else np.full(sample.count, default)

    x, y, angle = _place(names, get)
    ids = sample.ids.texts() if sample.ids is not None else []
    return Positions(sample.symbol, ids, x, y, angle)


def _of_nodes(
    pieces: Sequence[Piece], vocabulary: Vocabulary, placed: Mapping[str, frozenset[str]]
) -> Iterator[Positions]:
    """Positions of agents in these pieces, moved by the transformations around them."""
    posed: dict[str, list[tuple[AgentNode, Pose]]] = {}
    for piece in pieces:
        if isinstance(piece, AgentNode) and not piece.scope.pieces:  # The usual case.
            if piece.symbol in placed:
                posed.setdefault(piece.symbol, []).append((piece, _ORIGIN))
        else:
            _find(piece, vocabulary, placed, posed)
    for kind, agents in posed.items():
        yield _of_agents(kind, agents, placed[kind])


def _find(
    piece: Piece,
    vocabulary: Vocabulary,
    placed: Container[str],
    posed: dict[str, list[tuple[AgentNode, Pose]]],
) -> None:
    """Collect the agents within a piece, or the piece itself, with their poses."""
    poses = [_ORIGIN]
    for opens, node in walk(Scene((piece,))):
        if isinstance(node, FigureNode):
            continue
        if isinstance(node, TransformationNode):
            if opens:
                declared = vocabulary.transformations.get(node.symbol)
                motion = (declared.motion if declared is not None else None) or Motion()
                poses.append(after(motion, node.parameters, poses[-1]))
            else:
                poses.pop()
        elif opens and node.symbol in placed:
            posed.setdefault(node.symbol, []).append((node, poses[-1]))


def _of_agents(
    kind: str, posed: Sequence[tuple[AgentNode, Pose]], names: frozenset[str]
) -> Positions:
    nodes = [node for node, _ in posed]

    def get(name: str, default: float) -> Numbers:
        if name not in names:
            return np.full(len(nodes), default)
        usual = nodes[0].names
        at = usual.index(name)
        # Agents of one kind share the tuple of names, so its index is looked up once.
        values = [
            node.values[at if node.names is usual else node.names.index(name)] for node in nodes
        ]
        return np.array(values, np.float64)

    x, y, angle = _place(names, get)
    ids = [node.id for node in nodes]
    # Most agents are not inside of transformations.
    if all(pose is _ORIGIN for _, pose in posed):
        return Positions(kind, ids, x, y, angle)
    at = np.array([(pose.x, pose.y, pose.angle) for _, pose in posed])
    turned = np.radians(at[:, 2])
    # numpy's functions suffice here: these positions are only displayed and never enter the string.
    cos, sin = np.cos(turned), np.sin(turned)
    return Positions(
        kind, ids, at[:, 0] + x * cos - y * sin, at[:, 1] + x * sin + y * cos, at[:, 2] + angle
    )


def _place(names: frozenset[str], get: _Get) -> tuple[Numbers, Numbers, Numbers]:
    """x, y and angle of agents."""
    if names >= _PLANE:
        x, y = get("x", 0.0), get("y", 0.0)
    else:
        cell = get("cell", 1.0)
        x = get("x0", 0.0) + get("row", 0.0) * cell
        y = get("y0", 0.0) + get("column", 0.0) * cell
    if names >= {"vx", "vy"} and names.isdisjoint(("angle", "heading")):
        return x, y, np.degrees(np.arctan2(get("vy", 0.0), get("vx", 0.0)))
    return x, y, get("angle" if "angle" in names else "heading", 0.0)


def _together(kind: str, parts: Sequence[Positions]) -> Positions:
    if len(parts) == 1:
        return parts[0]
    return Positions(
        kind,
        [name for part in parts for name in part.ids],
        np.concatenate([part.x for part in parts]),
        np.concatenate([part.y for part in parts]),
        np.concatenate([part.angle for part in parts]),
    )


# --- rasters ---


def painted(raster: Raster, cells: Any) -> Any:
    """The colours of a raster's cells, (rows, columns, 4), red to alpha from 0 to 255."""
    painted = np.zeros((*cells.shape, 4), np.uint8)
    for least, color in raster.colors:
        painted[cells >= least] = _rgba(color, raster.opacity)
    return painted


def _rgba(color: str, opacity: float) -> tuple[int, int, int, int]:
    if not color:
        return 0, 0, 0, 0
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue, round(255 * opacity)


def without_agents(scene: Scene) -> Scene:
    """A string without its agents."""
    made: list[Piece] = []
    for piece in scene.pieces:
        if piece.still:
            made.append(piece)
        elif piece.ids is None:
            made += fill_slots(Scene((piece,)), lambda _: EMPTY).pieces
    return Scene(tuple(made))
