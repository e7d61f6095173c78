"""A geometric system of bounding volumes, with the owner of each figure (section 5).

"It would use the implementation of the functions α, β and δ to calculate the bounding box of the
elements." Here β and δ move a pose, and α places convex volumes for a primitive's shape:

    Disc     a disc
    Line     for each pair of neighbouring points, all within half its width of the segment
    Raster   boxes around the cells of its last colour if it has a height: these are solid
    Label    none

The owner of a volume is the agent whose view it is. If a figure, or a transformation around it, has
a text parameter `who`, the owner is the agent with that id. Parts of populations need it, because
their views are in columns, and so do agents in the scope of others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.appearance import Disc, Label, Line, Raster, Shape
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import FigureNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import Floats, outline, raster_corner, resolve, resolve_all
from minerva_bus.semantics.poses import Point, Pose
from minerva_services.geometry.incremental import ByParts, ItemGeometry, batched

Integers: TypeAlias = NDArray[np.int64]


def color_ranges(cells: NDArray[Any], colors: Iterable[tuple[int, str]]) -> NDArray[np.uint16]:
    """For each cell the number of its colour range, from 1; 0 below the first. Same shape."""
    numbers = np.zeros(cells.shape, np.uint16)
    for least, _ in colors:
        numbers += cells >= least
    return numbers


def rectangles(numbers: NDArray[np.uint16], drawn: NDArray[np.bool_]) -> tuple[Integers, ...]:
    """Rectangles that cover each cell whose number is `drawn` exactly once.

    Runs along the columns that continue unchanged in the next row merge to one rectangle. Returns
    five columns (n,), sorted by number, column and length of the run, and row: number, row, column,
    rows, columns.
    """
    rows, columns = numbers.shape
    if not numbers.size:
        return (np.empty(0, np.int64),) * 5
    opens = np.ones(numbers.shape, np.bool_)
    np.not_equal(numbers[:, 1:], numbers[:, :-1], out=opens[:, 1:])
    starts = np.flatnonzero(opens)
    lengths = np.diff(starts, append=numbers.size)
    number = numbers.ravel()[starts].astype(np.int64)
    shown = drawn[number]
    row, column = np.divmod(starts[shown], columns)
    # One integer for (number, column, length, row): after sorting, a run and its continuation in
    # the next row are neighbours that differ by 1. No row has the number `rows`, so no other pair
    # does.
    shape = number[shown] * columns + column
    runs = np.sort((shape * (columns + 1) + lengths[shown]) * (rows + 1) + row)
    heads = np.flatnonzero(np.diff(runs, prepend=-2) != 1)
    shape, row = np.divmod(runs[heads], rows + 1)
    shape, length = np.divmod(shape, columns + 1)
    number, column = np.divmod(shape, columns)
    return number, row, column, np.diff(heads, append=runs.size), length


def mask_rectangles(mask: NDArray[np.bool_]) -> Integers:
    """Rectangles (n, 4) of row, column, rows, columns that cover each true cell exactly once."""
    covered = rectangles(mask.astype(np.uint16), np.array([False, True]))
    return np.stack(covered[1:], axis=1)


Ints: TypeAlias = NDArray[np.intp]
Texts: TypeAlias = NDArray[np.object_]


@dataclass(frozen=True, slots=True, eq=False)
class Volumes:
    """n convex volumes in the order of the string: all points within a radius of a core.

    A core is the convex hull of a few points: one for a disc, two for a segment, three or more
    for a polygon, counter-clockwise.

    Attributes:
        points: (m, 2) metres, the points of all cores, one core after another.
        first: (n + 1,) index of the first point of each core, and the number of points.
        radius: (n,) metres.
        owners: (n,) ids of agents; "" for scenery.
        kinds: (n,) kinds of the outermost agents that own them; "" for scenery.
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
        """Number of points of each core; shape (n,)."""
        return np.diff(self.first)

    def cores(self, rows: Ints) -> Floats:
        """The points of cores that have k points each; shape (len(rows), k, 2)."""
        size = int(self.first[rows[0] + 1] - self.first[rows[0]]) if len(rows) else 1
        return self.points[self.first[rows][:, None] + np.arange(size)]

    def boxes(self) -> tuple[Floats, Floats]:
        """Lower left and upper right corners of the bounding boxes; shape (n, 2) each."""
        if not len(self):
            return np.zeros((0, 2)), np.zeros((0, 2))
        margin = self.radius[:, None]
        # Each core has at least one point, without which `reduceat` would take a point of the next
        # one.
        lower: Floats = np.minimum.reduceat(self.points, self.first[:-1], axis=0)
        upper: Floats = np.maximum.reduceat(self.points, self.first[:-1], axis=0)
        return lower - margin, upper + margin


@dataclass(frozen=True, slots=True)
class _Volume:
    """A single volume."""

    core: tuple[Point, ...]
    radius: float
    owner: str
    kind: str
    symbol: str


class BoundingVolumes(ItemGeometry["_Volume | Volumes"]):
    """φ of a view: the volumes of each shape; see the module.

    `who` is the name of the parameter with the id of a figure's owner.
    """

    def __init__(self, vocabulary: Vocabulary, who: str = "who") -> None:
        super().__init__(vocabulary)
        self._who = who
        self._named: list[str] = []

    def enter(self, transformation: TransformationNode) -> None:
        super().enter(transformation)
        # Parallel to the open transformations: the owner that applies within each.
        self._named.append(_text(transformation.parameters, self._who) or self._innermost())

    def leave(self, transformation: TransformationNode) -> None:
        self._named.pop()
        super().leave(transformation)

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        cores, radius = _cores(shape, figure.parameters, self.pose)
        if not cores:
            return
        owner = self._owner(_text(figure.parameters, self._who) or self._innermost(), figure.symbol)
        new = [_Volume(core, radius, owner, self.kind, figure.symbol) for core in cores]
        self.items += new

    def many(self, columns: Columns) -> bool:
        """Interpret columns of transformations around a disc at once."""
        levels = list(columns.levels())
        inner, count = levels[-1], columns.count
        primitive = self.vocabulary.primitives.get(inner.symbol)
        shape = primitive.shape if primitive is not None else None
        if not isinstance(shape, Disc):
            # Labels and primitives without a shape have no volume. Others are passed one by one.
            return not isinstance(shape, Line | Raster)
        x, y, _ = self.poses(levels[:-1], count)
        self.items.append(
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
        # From inside to outside: the innermost name applies.
        for level in reversed(levels):
            if self._who in level.names:
                named = level.column(self._who)
                if named.dtype == object and all(named):
                    return cast("Texts", named)
        return _same(self._owner(self._innermost(), levels[-1].symbol), count)

    def _innermost(self) -> str:
        """The owner that the innermost transformation with an owner names, or ""."""
        return self._named[-1] if self._named else ""

    def _owner(self, named: str, symbol: str) -> str:
        if not named and self.owner.startswith("~"):
            raise MisuseError(
                f"{symbol} in the view of the population {self.kind} has no owner; give it, or a"
                f" transformation around it, a text parameter {self._who} with the agent's id"
            )
        return named or self.owner


class Bodies:
    """Converts one view after another to volumes; unchanged parts are converted once."""

    def __init__(self, vocabulary: Vocabulary, who: str = "who") -> None:
        self._views = ByParts(BoundingVolumes(vocabulary, who))

    def volumes(self, skeleton: Scene, parts: Mapping[str, Scene]) -> Volumes:
        """The volumes of a view: of its static skeleton, and of its parts in their slots.

        Raises MisuseError if a figure of a population has no owner.
        """
        return _together(self._views.items(skeleton, parts))


def volumes(scene: Scene, vocabulary: Vocabulary, who: str = "who") -> Volumes:
    """The volumes of a string of L(E), in its order."""
    geometry = BoundingVolumes(vocabulary, who)
    interpret(scene, geometry)
    return _together(geometry.items)


def _cores(
    shape: Shape, parameters: Mapping[str, Any], at: Pose
) -> tuple[list[tuple[Point, ...]], float]:
    """The cores of a shape's volumes, and their radius."""
    if isinstance(shape, Raster):
        return _boxes(shape, parameters, at) if shape.height > 0 else [], 0.0
    if isinstance(shape, Label):
        return [], 0.0
    points, radius = outline(shape, parameters, at)
    pairs = zip(points, points[1:] or points, strict=False)
    # A segment of length 0 has no direction; as a point it is a valid core.
    return [pair if pair[0] != pair[1] else pair[:1] for pair in pairs], radius


def _boxes(raster: Raster, parameters: Mapping[str, Any], at: Pose) -> list[tuple[Point, ...]]:
    corner, cell = raster_corner(raster, parameters, at), resolve(raster.cell, parameters)
    boxes = mask_rectangles(parameters[raster.cells] >= raster.colors[-1][0])
    # From sizes to the row and column after the last.
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


def _together(items: Sequence[_Volume | Volumes]) -> Volumes:
    """All volumes as one batch, in order."""
    parts: list[Volumes] = batched(items, _Volume, _packed) or [_packed(())]
    return parts[0] if len(parts) == 1 else _concatenated(parts)


def _packed(volumes: Sequence[_Volume]) -> Volumes:
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
    objects = list(texts)
    array = np.empty(len(objects), object)
    array[:] = objects
    return array


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
