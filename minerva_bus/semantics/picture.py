"""A view as a list of things to draw, in order: what windows, pages and sounds have in common.

A geometric system whose actions make neither pixels nor triangles but plain numbers: where each
form stands, how large, in which colour, and which agent it belongs to. Drawing it is what is left
to a particular system.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.columns import Columns, walk_pieces
from minerva_bus.grammar.forms import Disc, Label, Line, Measure, Motion, Raster, Shape
from minerva_bus.grammar.scene import AgentNode, FigureNode, Piece, Scene, TransformationNode, still
from minerva_bus.grammar.symbols import Primitive
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry, Pose, resolve

Floats: TypeAlias = NDArray[np.float64]
Color: TypeAlias = tuple[int, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """n discs: places (m), angles (deg), radii (m), heights (m) of shape (n,), colours (n, 3).

    `heading` tells which have a mark where they head. `owners` are the fragments that they belong
    to, "" for what is static; `names` the first text among the parameters of each, or "".
    """

    x: Floats
    y: Floats
    angle: Floats
    radius: Floats
    height: Floats
    color: NDArray[np.uint8]
    heading: NDArray[np.bool_]
    names: Sequence[str]
    owners: Sequence[str]

    def __len__(self) -> int:
        return len(self.x)

    def agent(self, row: int) -> str:
        """The agent that a disc belongs to: its fragment, or in a population what it is called."""
        owner = self.owners[row]
        return self.names[row] if owner.startswith("~") else owner


@dataclass(frozen=True, slots=True, eq=False)
class Polyline:
    """A line through points of shape (n, 2), metres of the world."""

    points: Floats
    form: Line
    owner: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Texts:
    """n texts at places of shape (n,), metres."""

    x: Floats
    y: Floats
    texts: Sequence[str]
    form: Label
    owner: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """A matrix (rows, columns) as squares of `cell` metres; its corner (0, 0) is at the pose.

    Rows go along the pose's x axis, columns along its y axis. A matrix that is the same object as
    before has not changed.
    """

    cells: NDArray[Any]
    pose: Pose
    cell: float
    form: Raster
    owner: str = ""

    @property
    def size(self) -> tuple[float, float]:
        """Metres along the pose's axes."""
        rows, columns = self.cells.shape
        return rows * self.cell, columns * self.cell


Item: TypeAlias = Discs | Polyline | Texts | Tiles


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What a view draws, in the string's order."""

    items: tuple[Item, ...] = ()

    def of(self, kind: type[Any]) -> list[Any]:
        """The items of one kind."""
        return [item for item in self.items if isinstance(item, kind)]


@lru_cache(maxsize=1024)
def rgb(color: str) -> Color:
    """A colour #rrggbb or #rgb as numbers from 0 to 255; grey for anything else."""
    digits = color.removeprefix("#")
    digits = "".join(2 * one for one in digits) if len(digits) == 3 else digits
    try:
        red, green, blue = bytes.fromhex(digits)
    except ValueError:
        return (0x88, 0x88, 0x88)
    return red, green, blue


Row: TypeAlias = tuple[float, float, float, float, float, Color, bool, str, str]
Piecewise: TypeAlias = "list[Row | Item]"


def _name_of(primitive: Primitive) -> str:
    """The name of the first text among a primitive's parameters; "" where there is none."""
    return next((field.name for field in primitive.fields.all if field.type.kind == "text"), "")


class _Lister(PlaneGeometry):
    """φ of a view: lists what each form is, single discs as rows that are put together later."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.owner = ""
        self.listed: Piecewise = []
        self._names = {name: _name_of(one) for name, one in vocabulary.primitives.items()}

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        parameters, at = figure.parameters, self.pose
        if isinstance(shape, Disc):
            name = self._names[figure.symbol]
            self.listed.append(
                (
                    at.x,
                    at.y,
                    at.angle,
                    resolve(shape.radius, parameters),
                    shape.height,
                    rgb(shape.color),
                    shape.heading,
                    str(parameters[name]) if name else "",
                    self.owner,
                )
            )
        elif isinstance(shape, Line):
            self.listed.append(Polyline(_points(shape, figure, at), shape, self.owner))
        elif isinstance(shape, Raster):
            self.listed.append(_tiles(shape, figure, at, self.owner))
        else:
            here = np.array([at.x]), np.array([at.y])
            self.listed.append(Texts(*here, (str(parameters[shape.text]),), shape, self.owner))

    def many(self, columns: Columns) -> bool:
        """Many of one shape at once: transformations that lead to a disc or a text."""
        levels = list(columns.levels())
        inner = levels[-1]
        primitive = self.vocabulary.primitives.get(inner.symbol)
        if primitive is None:
            return inner.symbol in self.vocabulary.transformations
        shape = primitive.shape
        if shape is None:
            return True
        if not isinstance(shape, Disc | Label):
            return False
        x, y, angle = self._poses(levels[:-1], columns.count)
        if isinstance(shape, Label):
            texts = tuple(map(str, inner.column(shape.text)))
            self.listed.append(Texts(x, y, texts, shape, self.owner))
            return True
        name, n = self._names[inner.symbol], columns.count
        self.listed.append(
            Discs(
                x,
                y,
                angle,
                _measured(shape.radius, inner),
                np.full(n, shape.height),
                np.tile(np.array(rgb(shape.color), np.uint8), (n, 1)),
                np.full(n, shape.heading),
                cast("Sequence[str]", inner.column(name)) if name else _Same("", n),
                _Same(self.owner, n),
            )
        )
        return True

    def _poses(self, levels: Sequence[Columns], count: int) -> tuple[Floats, Floats, Floats]:
        """Where a chain of transformations leads, for each row."""
        at = self.pose
        x, y, angle = np.full(count, at.x), np.full(count, at.y), np.full(count, at.angle)
        for level in levels:
            declared = self.vocabulary.transformations.get(level.symbol)
            motion = (declared.motion if declared is not None else None) or Motion()
            dx, dy = _measured(motion.x, level), _measured(motion.y, level)
            turn = np.radians(angle)
            cos, sin = np.cos(turn), np.sin(turn)
            x, y = x + dx * cos - dy * sin, y + dx * sin + dy * cos
            angle = angle + _measured(motion.turn, level)
            forward, turn = _measured(motion.forward, level), np.radians(angle)
            x, y = x + forward * np.cos(turn), y + forward * np.sin(turn)
        return x, y, angle


class _Same(Sequence[str]):
    """One text, n times."""

    def __init__(self, text: str, count: int) -> None:
        self._text, self._count = text, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, slice):
            return _Same(self._text, len(range(*at.indices(self._count))))
        return self._text


def _measured(measure: Measure, level: Columns) -> Floats:
    if isinstance(measure, str):
        return np.asarray(level.column(measure), np.float64)
    return np.full(level.count, float(measure))


def _points(line: Line, figure: FigureNode, at: Pose) -> Floats:
    xs, ys = (np.asarray(figure.parameters[one], np.float64) for one in (line.xs, line.ys))
    n, turn = min(len(xs), len(ys)), np.radians(at.angle)
    x, y, cos, sin = xs[:n], ys[:n], np.cos(turn), np.sin(turn)
    return np.stack([at.x + x * cos - y * sin, at.y + x * sin + y * cos], axis=1)


def _tiles(raster: Raster, figure: FigureNode, at: Pose, owner: str) -> Tiles:
    p = figure.parameters
    corner = at.then(resolve(raster.x, p), resolve(raster.y, p), resolve(raster.turn, p), 0.0)
    return Tiles(p[raster.cells], corner, resolve(raster.cell, p), raster, owner)


class Lists:
    """Makes the picture of one view after another; what has not changed is listed once."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self._lister = _Lister(vocabulary)
        self._skeleton: Scene | None = None
        self._static: dict[int, Piecewise] = {}
        self._parts: dict[str, tuple[Scene, Piecewise]] = {}

    def picture(self, skeleton: Scene, parts: Mapping[str, Scene]) -> Picture:
        """The picture of a view: its static skeleton, and in its slots what agents look like."""
        if skeleton is not self._skeleton:
            self._skeleton, self._static = skeleton, {}
            self._parts = {name: known for name, known in self._parts.items() if name in parts}
        listed = [self._piece(at, one, parts) for at, one in enumerate(skeleton.pieces)]
        return Picture(tuple(_together(list(chain.from_iterable(listed)))))

    def _piece(self, at: int, piece: Piece, parts: Mapping[str, Scene]) -> Piecewise:
        if isinstance(piece, AgentNode):
            return self._part(piece.id, parts.get(piece.id))
        if isinstance(piece, TransformationNode) and not still(piece):
            return self._around(piece, parts)
        if at not in self._static:
            self._static[at] = self._listed("", Scene((piece,)))
        return self._static[at]

    def _part(self, name: str, part: Scene | None) -> Piecewise:
        if part is None:
            return []
        known = self._parts.get(name)
        if known is None or known[0] is not part:
            known = self._parts[name] = part, self._listed(name, part)
        return known[1]

    def _around(self, piece: Piece, parts: Mapping[str, Scene]) -> Piecewise:
        """A transformation with agents in its scope."""
        lister = self._lister
        lister.listed = []
        for opens, node in walk_pieces(Scene((piece,)), lister.many):
            if isinstance(node, AgentNode):
                if opens and node.id in parts:
                    lister.owner = node.id
                    interpret(parts[node.id], lister)
                    lister.owner = ""
            elif isinstance(node, FigureNode):
                lister.draw(node)
            elif opens:
                lister.enter(node)
            else:
                lister.leave(node)
        return lister.listed

    def _listed(self, owner: str, scene: Scene) -> Piecewise:
        lister = self._lister
        lister.listed, lister.owner = [], owner
        interpret(scene, lister)
        lister.owner = ""
        return lister.listed


def _together(listed: Piecewise) -> list[Item]:
    """Rows of discs as arrays, and neighbouring discs as one batch."""
    items: list[Item] = []
    rows: list[Row] = []
    for one in listed:
        if isinstance(one, tuple):
            rows.append(one)
            continue
        if rows:
            items.append(_discs(rows))
            rows = []
        items.append(one)
    if rows:
        items.append(_discs(rows))
    return items


def _discs(rows: list[Row]) -> Discs:
    x, y, angle, radius, height, color, heading, names, owners = zip(*rows, strict=True)
    return Discs(
        np.array(x, np.float64),
        np.array(y, np.float64),
        np.array(angle, np.float64),
        np.array(radius, np.float64),
        np.array(height, np.float64),
        np.array(color, np.uint8),
        np.array(heading, np.bool_),
        names,
        owners,
    )
