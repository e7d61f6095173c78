"""A geometric system of bounding volumes: what a string draws, how large, and whose (section 5).

"It would use the implementation of the functions α, β and δ to calculate the bounding box of the
elements." Here β and δ move a pose about, α puts a convex volume where a primitive's shape is:

    Disc     a disc
    Line     for each two points that follow one another all within half its width of their segment
    Raster   boxes round the cells of its last colour, where it has a height: these stand
    Label    nothing

What is drawn belongs to the agent whose view it is. A figure that carries a text `who`, by itself
or by a transformation around it, belongs to the agent of that name: within populations, where views
are in columns, and among agents in the scope of others, nothing else could tell.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.forms import Disc, Label, Line, Raster, Shape
from minerva_bus.grammar.scene import FigureNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.by_parts import ByParts, Lister
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import Floats, outline, raster_corner, resolve, resolve_all
from minerva_bus.semantics.poses import Point, Pose
from minerva_bus.semantics.rectangles import mask_rectangles

Ints: TypeAlias = NDArray[np.intp]
Texts: TypeAlias = NDArray[np.object_]


@dataclass(frozen=True, slots=True, eq=False)
class Volumes:
    """n convex volumes in the order of the string: all within a radius of their cores.

    A core is the hull of a few points: one of a disc, two of a segment, three and more of a
    polygon, counter-clockwise.

    Attributes:
        points: (m, 2) metres, the points of all cores, one core after another.
        first: (n + 1,) where each core begins in them, and the end.
        radius: (n,) metres.
        owners: (n,) ids of agents; "" for scenery.
        kinds: (n,) the kinds of these agents, those of the outermost; "" for scenery.
        symbols: (n,) the primitives.

    """

    points: Floats
    first: Ints
    radius: Floats
    owners: Texts
    kinds: Texts
    symbols: Texts

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def sizes(self) -> Ints:
        """How many points each core has; shape (n,)."""
        return np.diff(self.first)

    def cores(self, rows: Ints) -> Floats:
        """The points of some cores that have k points each; shape (len(rows), k, 2)."""
        size = int(self.first[rows[0] + 1] - self.first[rows[0]]) if len(rows) else 1
        return self.points[self.first[rows][:, None] + np.arange(size)]

    def boxes(self) -> tuple[Floats, Floats]:
        """The lower left and the upper right corners of upright boxes around; shape (n, 2) each."""
        if not len(self):
            return np.zeros((0, 2)), np.zeros((0, 2))
        margin = self.radius[:, None]
        lower: Floats = np.minimum.reduceat(self.points, self.first[:-1], axis=0)
        upper: Floats = np.maximum.reduceat(self.points, self.first[:-1], axis=0)
        return lower - margin, upper + margin


@dataclass(frozen=True, slots=True)
class _One:
    """A volume by itself."""

    core: tuple[Point, ...]
    radius: float
    owner: str
    kind: str
    symbol: str


class BoundingVolumes(Lister["_One | Volumes"]):
    """φ of a view: the volume of each shape. See the module.

    `who` is what the parameter is called that says whose a figure is.
    """

    def __init__(self, vocabulary: Vocabulary, who: str = "who") -> None:
        super().__init__(vocabulary)
        self._who = who
        self._named: list[str] = []

    def enter(self, transformation: TransformationNode) -> None:
        super().enter(transformation)
        self._named.append(_text(transformation.parameters, self._who) or self._innermost())

    def leave(self, transformation: TransformationNode) -> None:
        self._named.pop()
        super().leave(transformation)

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        cores, radius = _cores(shape, figure.parameters, self.pose)
        if not cores:
            return
        owner = self._owner(_text(figure.parameters, self._who) or self._innermost(), figure.symbol)
        new = [_One(core, radius, owner, self.kind, figure.symbol) for core in cores]
        self.listed += new

    def many(self, columns: Columns) -> bool:
        """Many of one shape at once: transformations that lead to a disc."""
        levels = list(columns.levels())
        inner, count = levels[-1], columns.count
        primitive = self.vocabulary.primitives.get(inner.symbol)
        shape = primitive.shape if primitive is not None else None
        if not isinstance(shape, Disc):
            return not isinstance(shape, Line | Raster)
        x, y, _ = self.poses(levels[:-1], count)
        self.listed.append(
            Volumes(
                np.column_stack((x, y)),
                np.arange(count + 1),
                resolve_all(shape.radius, inner),
                self._owners(levels, count),
                _same(self.kind, count),
                _same(inner.symbol, count),
            )
        )
        return True

    def _owners(self, levels: Sequence[Columns], count: int) -> Texts:
        for level in reversed(levels):
            if self._who in level.names:
                named = level.column(self._who)
                if named.dtype == object and all(named):
                    return cast("Texts", named)
        return _same(self._owner(self._innermost(), levels[-1].symbol), count)

    def _innermost(self) -> str:
        """Who a transformation around this place says that it belongs to, or ""."""
        return self._named[-1] if self._named else ""

    def _owner(self, named: str, symbol: str) -> str:
        if not named and self.owner.startswith("~"):
            raise MisuseError(
                f"{symbol}, by which agents of the population {self.kind} are shown, does not say"
                f" whose it is; give it, or a transformation around it, a text {self._who} with"
                " the agent's id"
            )
        return named or self.owner


class Bodies:
    """Finds the volumes of one view after another; parts that have not changed are kept."""

    def __init__(self, vocabulary: Vocabulary, who: str = "who") -> None:
        self._views = ByParts(BoundingVolumes(vocabulary, who))

    def volumes(self, skeleton: Scene, parts: Mapping[str, Scene]) -> Volumes:
        """The volumes of a view: of its static skeleton, and in its slots of agents.

        Raises MisuseError where a figure of a population does not say whose it is.
        """
        return _together(self._views.listed(skeleton, parts))


def volumes(scene: Scene, vocabulary: Vocabulary, who: str = "who") -> Volumes:
    """The volumes of a string of L(E), in its order."""
    geometry = BoundingVolumes(vocabulary, who)
    interpret(scene, geometry)
    return _together(geometry.listed)


def _cores(
    shape: Shape, parameters: Mapping[str, Any], at: Pose
) -> tuple[list[tuple[Point, ...]], float]:
    """The cores of a shape's volumes, and the radius around them."""
    if isinstance(shape, Raster):
        return _boxes(shape, parameters, at) if shape.height > 0 else [], 0.0
    if isinstance(shape, Label):
        return [], 0.0
    points, radius = outline(shape, parameters, at)
    pairs = zip(points, points[1:] or points, strict=False)
    return [pair if pair[0] != pair[1] else pair[:1] for pair in pairs], radius


def _boxes(raster: Raster, parameters: Mapping[str, Any], at: Pose) -> list[tuple[Point, ...]]:
    corner, cell = raster_corner(raster, parameters, at), resolve(raster.cell, parameters)
    boxes = mask_rectangles(parameters[raster.cells] >= raster.colors[-1][0])
    boxes[:, 2:] += boxes[:, :2]
    # Sorted by last row and first column: contacts list the boxes of a wall in this order.
    boxes = boxes[np.lexsort((boxes[:, 1], boxes[:, 2]))] * cell
    return [
        (corner.point(a, b), corner.point(c, b), corner.point(c, d), corner.point(a, d))
        for a, b, c, d in boxes.tolist()
    ]


def _text(parameters: Mapping[str, Any], name: str) -> str:
    value = parameters.get(name, "")
    return value if isinstance(value, str) else ""


def _same(text: str, count: int) -> Texts:
    return np.full(count, text, object)


def _together(listed: Sequence[_One | Volumes]) -> Volumes:
    """All in one, in order."""
    parts: list[Volumes] = []
    single: list[_One] = []
    for value in listed:
        if isinstance(value, _One):
            single.append(value)
            continue
        if single:
            parts.append(_packed(single))
            single = []
        parts.append(value)
    if single or not parts:
        parts.append(_packed(single))
    return parts[0] if len(parts) == 1 else _concatenated(parts)


def _packed(volumes: Sequence[_One]) -> Volumes:
    points = [point for volume in volumes for point in volume.core]
    sizes = [len(volume.core) for volume in volumes]
    return Volumes(
        np.array(points, np.float64).reshape(-1, 2),
        np.concatenate(([0], np.cumsum(sizes, dtype=np.intp))).astype(np.intp),
        np.array([volume.radius for volume in volumes], np.float64),
        _objects(volume.owner for volume in volumes),
        _objects(volume.kind for volume in volumes),
        _objects(volume.symbol for volume in volumes),
    )


def _objects(texts: Iterable[str]) -> Texts:
    listed = list(texts)
    made = np.empty(len(listed), object)
    made[:] = listed
    return made


def _concatenated(parts: Sequence[Volumes]) -> Volumes:
    sizes = np.concatenate([part.sizes for part in parts])
    return Volumes(
        np.concatenate([part.points for part in parts]),
        np.concatenate(([0], np.cumsum(sizes))).astype(np.intp),
        np.concatenate([part.radius for part in parts]),
        np.concatenate([part.owners for part in parts]),
        np.concatenate([part.kinds for part in parts]),
        np.concatenate([part.symbols for part in parts]),
    )
