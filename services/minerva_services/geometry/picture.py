"""Display lists: a view as arrays of discs, lines, texts and matrices, in drawing order.

The actions of this geometric system produce numbers instead of pixels or triangles: position, size,
colour and owner of each form. Windows and web pages draw the display list.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.entry_points import entries
from minerva_bus.grammar.appearance import Disc, Label, Line, Raster, Shape
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Primitive, Vocabulary
from minerva_bus.semantics.plane import raster_corner, resolve, resolve_all
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import WorldInfo
from minerva_services.geometry.colors import (
    Color,
    DrawnColors,
    Legend,
    color_of,
    merged,
    rgb,
    rgbs_of,
)
from minerva_services.geometry.incremental import ByParts, ItemGeometry, batched

Floats: TypeAlias = NDArray[np.float64]


class _Owned:
    """Things with names and owners, each of length n."""

    __slots__ = ()
    names: Sequence[str]
    owners: Sequence[str]

    def agent(self, row: int) -> str:
        """The agent that owns a thing: its fragment, or the thing's name within a population."""
        owner = self.owners[row]
        return self.names[row] if owner.startswith("~") else owner


@dataclass(frozen=True, slots=True, eq=False)
class Discs(_Owned):
    """n discs: positions (m), angles (deg), radii (m), heights (m), each (n,); colours (n, 3).

    `heading` selects those with a mark in the direction of their angle. `owners` are the names of
    their fragments, "" for static ones; `names` the first text parameter of each, or "".
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


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """Vertices (n, 3) and triangles (m, 3) of indices, counter-clockwise from outside.

    Triangles that share a vertex are one smooth surface; at an edge, each has vertices of its own.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class Copies(_Owned):
    """n copies of a solid in space, for views in three dimensions.

    Positions (n, 3) in metres, rotations (n, 4) as quaternions w, x, y, z, factors of the solid's
    size along its axes (n, 3), colours (n, 3); `names` and `owners` as those of discs.
    """

    solid: Solid
    places: Floats
    turns: Floats
    sizes: Floats
    color: NDArray[np.uint8]
    names: Sequence[str]
    owners: Sequence[str]

    def __len__(self) -> int:
        return len(self.places)

    def points(self) -> Floats:
        """The vertices of all copies in the world, metres; shape (n, vertices, 3)."""
        scaled = self.solid.vertices[None] * self.sizes[:, None]
        return np.einsum("ijn,nkj->nki", self._axes(), scaled) + self.places[:, None]

    def _axes(self) -> Floats:
        """Matrices of the rotations; shape (3, 3, n)."""
        w, x, y, z = self.turns.T
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    def extents(self) -> tuple[Floats, Floats]:
        """Lower and upper corners of the bounding boxes, metres; shape (n, 3) each."""
        low, high = (
            self.sizes * (edge(self.solid.vertices, axis=0))[None, :] for edge in (np.min, np.max)
        )
        axes = self._axes()
        middle = np.einsum("ijn,nj->ni", axes, (low + high) / 2) + self.places
        reach = np.einsum("ijn,nj->ni", np.abs(axes), (high - low) / 2)
        return middle - reach, middle + reach


@dataclass(frozen=True, slots=True, eq=False)
class Polyline:
    """A line through points of shape (n, 2), metres."""

    points: Floats
    form: Line
    owner: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Texts:
    """n texts at x and y, metres, each of shape (n,)."""

    x: Floats
    y: Floats
    texts: Sequence[str]
    form: Label
    owner: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """A matrix (rows, columns) as squares of `cell` metres; its corner (0, 0) is at the pose.

    Rows extend along the pose's x axis, columns along its y axis. A matrix that is the same object
    as in the previous picture has not changed.
    """

    cells: NDArray[Any]
    pose: Pose
    cell: float
    form: Raster
    owner: str = ""

    @property
    def size(self) -> tuple[float, float]:
        """Extent in metres along the pose's axes."""
        rows, columns = self.cells.shape
        return rows * self.cell, columns * self.cell


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Texts whose labels, wherever they are, have the form's colour instead of their own."""

    texts: Sequence[str]
    form: Label
    owner: str = ""


Item: TypeAlias = Discs | Copies | Polyline | Texts | Tiles | Marks


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """The display list of a view, in the order of the string.

    `legend` explains all primitives of this view and of the previous ones of the same `Lists`.
    """

    items: tuple[Item, ...] = ()
    legend: Legend = ()

    def of(self, kind: type[Any]) -> list[Any]:
        """The items of a class."""
        return [item for item in self.items if isinstance(item, kind)]

    def marked(self) -> dict[str, str]:
        """The colours of marked labels, by text."""
        return {text: marks.form.color for marks in self.of(Marks) for text in marks.texts}


def combined(pictures: Sequence[Picture]) -> Picture:
    """The pictures over each other; a single one keeps its identity, by which views cache it."""
    if len(pictures) == 1:
        return pictures[0]
    items = [item for picture in pictures for item in picture.items]
    entries = [entry for picture in pictures for entry in picture.legend]
    return Picture(tuple(items), merged(entries))


Row: TypeAlias = tuple[float, float, float, float, float, Color, bool, str, str]


def text_parameter(primitive: Primitive) -> str:
    """A primitive's first text parameter, by which things are named; "" if it has none."""
    return next((field.name for field in primitive.fields.all if field.type.kind == "text"), "")


class PictureGeometry(ItemGeometry[Any]):
    """φ of a view: an item for each form; single discs are rows until they are batched."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.names = {
            name: text_parameter(primitive) for name, primitive in vocabulary.primitives.items()
        }
        self.drawn = DrawnColors()
        """What is drawn so far. Parts that have not changed are not drawn again."""

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        parameters, at = figure.parameters, self.pose
        self.drawn.figure(figure.symbol, shape, parameters)
        if isinstance(shape, Disc):
            name = self.names[figure.symbol]
            self.items.append(
                (
                    at.x,
                    at.y,
                    at.angle,
                    resolve(shape.radius, parameters),
                    shape.height,
                    rgb(color_of(shape.color, parameters)),
                    shape.heading,
                    str(parameters[name]) if name else "",
                    self.owner,
                )
            )
        elif isinstance(shape, Line):
            self.items.append(Polyline(_points(shape, figure, at), shape, self.owner))
        elif isinstance(shape, Raster):
            self.items.append(_tiles(shape, figure, at, self.owner))
        elif shape.marks:
            self.items.append(Marks((str(parameters[shape.text]),), shape, self.owner))
        else:
            here = np.array([at.x]), np.array([at.y])
            self.items.append(Texts(*here, (str(parameters[shape.text]),), shape, self.owner))

    def many(self, columns: Columns) -> bool:
        """Interpret columns of transformations around a disc or a text at once."""
        levels = list(columns.levels())
        inner = levels[-1]
        primitive = self.vocabulary.primitives.get(inner.symbol)
        if primitive is None:
            # Transformations around nothing draw nothing; other unknown symbols are passed one by
            # one.
            return inner.symbol in self.vocabulary.transformations
        shape = primitive.shape
        if shape is None:
            return True
        # Lines and rasters have lists or matrices as parameters, which columns do not hold.
        if not isinstance(shape, Disc | Label):
            return False
        self.drawn.columns(inner.symbol, shape.color, inner)
        x, y, angle = self.poses(levels[:-1], columns.count)
        if isinstance(shape, Label):
            texts = tuple(map(str, inner.column(shape.text)))
            if shape.marks:
                self.items.append(Marks(texts, shape, self.owner))
                return True
            self.items.append(Texts(x, y, texts, shape, self.owner))
            return True
        name, n = self.names[inner.symbol], columns.count
        self.items.append(
            Discs(
                x,
                y,
                angle,
                resolve_all(shape.radius, inner),
                np.full(n, shape.height),
                rgbs_of(shape.color, inner),
                np.full(n, shape.heading),
                cast("Sequence[str]", inner.column(name)) if name else RepeatedText("", n),
                RepeatedText(self.owner, n),
            )
        )
        return True

    def batched(self, items: Sequence[Any]) -> list[Item]:
        """The items of a view, with neighbouring discs as one `Discs`."""
        return batched(items, tuple, _discs)


def geometry_in_space(world: WorldInfo) -> PictureGeometry:
    """The geometry of views in three dimensions.

    That of an installed package (the entry points `minerva.pictures`) for a vocabulary with forms
    in space, or else that of the plane, in which things have a height.
    """
    declared = [each.shape for each in world.vocabulary.primitives.values()]
    if any(shape.spatial for shape in declared if shape is not None):
        for entry in entries("minerva.pictures").values():
            return cast("PictureGeometry", entry.load()(world))
    return PictureGeometry(world.vocabulary)


class RepeatedText(Sequence[str]):
    """A sequence of n equal texts; a list of a million would cost memory in every frame."""

    def __init__(self, text: str, count: int) -> None:
        self._text, self._count = text, count

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[str]:
        # That of sequences ends at an IndexError, which `__getitem__` does not raise.
        return repeat(self._text, self._count)

    def __getitem__(self, at: Any) -> Any:
        if isinstance(at, slice):
            return RepeatedText(self._text, len(range(*at.indices(self._count))))
        return self._text


def _points(line: Line, figure: FigureNode, at: Pose) -> Floats:
    xs, ys = (
        np.asarray(figure.parameters[coordinates], np.float64) for coordinates in (line.xs, line.ys)
    )
    n, turn = min(len(xs), len(ys)), np.radians(at.angle)
    # Functions of numpy suffice: a picture does not enter the string.
    x, y, cos, sin = xs[:n], ys[:n], np.cos(turn), np.sin(turn)
    return np.stack([at.x + x * cos - y * sin, at.y + x * sin + y * cos], axis=1)


def _tiles(raster: Raster, figure: FigureNode, at: Pose, owner: str) -> Tiles:
    parameters = figure.parameters
    corner, cell = raster_corner(raster, parameters, at), resolve(raster.cell, parameters)
    return Tiles(parameters[raster.cells], corner, cell, raster, owner)


class Lists:
    """Converts one view after another to a picture; unchanged parts are converted once.

    Args:
        vocabulary: of the world.
        geometry: what the forms mean; None for the plane.

    """

    def __init__(self, vocabulary: Vocabulary, geometry: PictureGeometry | None = None) -> None:
        self._geometry = geometry or PictureGeometry(vocabulary)
        self._views = ByParts(self._geometry)
        self._explained = 0
        self._legend: Legend = ()

    def picture(self, skeleton: Scene, parts: Mapping[str, Scene]) -> Picture:
        """The picture of a view: its static skeleton, and its parts in their slots."""
        items = self._geometry.batched(self._views.items(skeleton, parts))
        drawn = self._geometry.drawn
        if len(drawn) > self._explained:
            self._explained = len(drawn)
            self._legend = drawn.legend(self._geometry.vocabulary)
        return Picture(tuple(items), self._legend)


def _discs(rows: Sequence[Row]) -> Item:
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
