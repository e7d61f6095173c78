"""The geometric system of views in three dimensions: a string as copies of solids in space.

Other forms, such as lines and labels, remain on the ground, as in the plane.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.assets import connect
from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import CAMERA, JOINTS, MATERIAL, POSTER, SIZES
from minerva_bodies.geometry import moved, value_of
from minerva_bodies.meshes import ground
from minerva_bodies.rigid import Rigid, product
from minerva_bodies.sensors import SENSORS
from minerva_bodies.shapes import solid_of, unit_solid
from minerva_bus.grammar.appearance import Measure, Motion, Raster, Shape, Spatial
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import FigureNode, TransformationNode
from minerva_bus.semantics.plane import resolve_all
from minerva_bus.world.services import WorldInfo
from minerva_services.geometry.colors import Color, rgb
from minerva_services.geometry.incremental import batched
from minerva_services.geometry.picture import (
    Copies,
    Floats,
    Item,
    PictureGeometry,
    RepeatedText,
    Solid,
)
from minerva_services.geometry.volumes import color_ranges, mask_rectangles

MANY = 1000
"""Number of copies from which round solids have few sides."""

_Key: TypeAlias = "tuple[str, float | str] | Solid"
"""A form and its detail, see `unit_solid`; or a solid of its own."""
_Numbers: TypeAlias = tuple[float, ...]


class _Row(NamedTuple):
    """A single solid."""

    key: _Key
    pose: _Numbers
    size: _Numbers
    color: Color
    name: str
    owner: str


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """n solids of a key; see `Copies`."""

    key: _Key
    places: Floats
    turns: Floats
    sizes: Floats
    color: NDArray[np.uint8]
    names: Sequence[str]
    owners: Sequence[str]


class SpacePictures(PictureGeometry):
    """φ of a view in space; the display list has `Copies` instead of the discs of solids."""

    def __init__(self, world: WorldInfo) -> None:
        connect(world)
        super().__init__(world.vocabulary)
        self.rigid = Rigid()
        # Of the last terrains and posters, whose matrices a view shows again and again.
        self._known: dict[tuple[int, Raster, float], tuple[Any, list[tuple[Solid, Color]]]] = {}

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        """β and δ: move the pose in space, and the one on the ground."""
        return self._both(transformation)

    @contextmanager
    def _both(self, node: TransformationNode) -> Generator[None]:
        before, motion = self.rigid, self._motion(node.symbol)
        if not motion.spatial or motion.spatial[0] in _MOTIONS:
            self.rigid = before.then(moved(motion, node, self.owner))
        with super().other_transformation(node):
            yield
        self.rigid = before

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        """α of a solid, at `rigid`; joints and sensors are not seen; others as in the plane."""
        if not shape.spatial:
            super().shape(shape, figure)
            return
        form, *measures = shape.spatial
        if form in (*JOINTS, *SENSORS, CAMERA):
            return
        self.drawn.figure(figure.symbol, shape, figure.parameters)
        name = self.names[figure.symbol]
        rest = str(figure.parameters[name]) if name else "", self.owner
        if isinstance(shape, Raster):
            cells, cell = figure.parameters[shape.cells], value_of(shape.cell, figure, self.owner)
            for solid, color in self._surfaces(shape, cells, cell):
                self.items.append(_Row(solid, self.rigid.numbers, (1.0,) * 3, color, *rest))
            return
        values = [value_of(each, figure, self.owner) for each in measures[MATERIAL:]]
        key, size = _scaled(str(form), values)
        self.items.append(_Row(key, self.rigid.numbers, size, rgb(shape.color), *rest))

    def many(self, columns: Columns) -> bool:
        """Interpret columns of transformations around boxes and round solids at once."""
        levels = list(columns.levels())
        inner, n = levels[-1], columns.count
        primitive = self.vocabulary.primitives.get(inner.symbol)
        shape = primitive.shape if primitive is not None else None
        if shape is None or not shape.spatial:
            return super().many(columns)
        sizes = shape.spatial[1 + MATERIAL :]
        if shape.spatial[0] not in _SCALED or isinstance(shape, Raster):
            # Each has a solid of its own.
            return False
        self.drawn.columns(inner.symbol, shape.color, inner)
        here: list[Any] = [np.full(n, number) for number in self.rigid.numbers]
        at: Any = Rigid(*here)
        for level in levels[:-1]:
            at = _moved_all(at, self._motion(level.symbol), level)
        _, scale = _scaled(str(shape.spatial[0]), [resolve_all(size, inner) for size in sizes])
        name = self.names[inner.symbol]
        self.items.append(
            _Rows(
                (str(shape.spatial[0]), 0.0),
                np.column_stack((at.x, at.y, at.z)),
                np.column_stack((at.w, at.i, at.j, at.k)),
                np.column_stack(scale),
                np.tile(np.array(rgb(shape.color), np.uint8), (n, 1)),
                cast("Sequence[str]", inner.column(name)) if name else RepeatedText("", n),
                RepeatedText(self.owner, n),
            )
        )
        return True

    def batched(self, items: Sequence[Any]) -> list[Item]:
        """All copies of each solid as one item, in the order of their first ones."""
        groups: dict[_Key, list[Any]] = {}
        for item in items:
            if isinstance(item, _Row | _Rows):
                groups.setdefault(item.key, []).append(item)
        others = [item for item in items if not isinstance(item, _Row | _Rows)]
        packed = {key: batched(group, _Row, _packed) for key, group in groups.items()}
        fine = sum(len(rows.places) for parts in packed.values() for rows in parts) < MANY
        return super().batched(others) + [
            _copies(key if isinstance(key, Solid) else unit_solid(*key, fine), parts)
            for key, parts in packed.items()
        ]

    def _surfaces(self, raster: Raster, cells: Any, cell: float) -> list[tuple[Solid, Color]]:
        key = id(cells), raster, cell
        known = self._known.get(key)
        if known is None:
            while len(self._known) >= _MAX_KNOWN:
                del self._known[next(iter(self._known))]
            make = _squares if raster.spatial[0] == POSTER else _ground
            # With its matrix, or another one could get its id.
            known = self._known[key] = cells, list(make(raster, cells, cell))
        return known[1]


_MOTIONS = ("euler", "quaternion")
_SCALED = ("box", "ball", "cylinder", "cone")
"""Forms of which all solids are copies of one."""
_MAX_KNOWN = 64


def _scaled(form: str, sizes: Sequence[Any]) -> tuple[_Key, tuple[Any, ...]]:
    """The key of a solid, and its size along x, y and z."""
    if form not in SIZES:
        raise BodiesError(f"the form {form!r} in space; expected one of {', '.join(SIZES)}")
    if form == "box":
        return ("box", 0.0), tuple(sizes)
    if form == "ball":
        return ("ball", 0.0), (sizes[0],) * 3
    if form == "mesh":
        return ("mesh", sizes[0]), (sizes[1],) * 3
    half, radius = sizes
    if form == "capsule":
        return ("capsule", round(half / radius, 3)), (radius,) * 3
    return (form, 0.0), (radius, radius, half)


def _moved_all(at: Any, motion: Motion, level: Columns) -> Any:
    """Poses in columns, moved by a level of transformations; both are `Rigid` of arrays."""
    spatial: Spatial = motion.spatial or ("euler", 0.0, 0.0, 0.0)
    if spatial[0] not in _MOTIONS:
        return at

    def column(measure: Measure) -> Floats:
        return resolve_all(measure, level)

    x, y = column(motion.x), column(motion.y)
    z, *rest = map(column, spatial[1:])
    zeros = np.zeros(level.count)
    if spatial[0] == "quaternion":
        length = np.sqrt(sum(part * part for part in rest))
        return _then(at, x, y, z, *[part / length for part in rest])
    at = _then(at, x, y, z, zeros + 1.0, zeros, zeros, zeros)
    # Functions of numpy suffice: a picture does not enter the string.
    for angle, axis in zip((column(motion.turn), *rest), (2, 1, 0), strict=True):
        if angle.any():
            half, parts = np.radians(angle) / 2, [zeros] * 3
            parts[axis] = np.sin(half)
            at = _then(at, zeros, zeros, zeros, np.cos(half), *parts)
    return _then(at, column(motion.forward), *[zeros] * 2, zeros + 1.0, *[zeros] * 3)


def _then(at: Any, *by: Any) -> Any:
    inner = Rigid(*by)
    x, y, z = at.turned(*by[:3])
    return Rigid(at.x + x, at.y + y, at.z + z, *product(at, inner))


def _packed(rows: Sequence[_Row]) -> _Rows:
    keys, poses, sizes, colors, names, owners = zip(*rows, strict=True)
    numbers = np.array(poses, np.float64)
    return _Rows(
        keys[0],
        numbers[:, :3],
        numbers[:, 3:],
        np.array(sizes, np.float64),
        np.array(colors, np.uint8),
        names,
        owners,
    )


def _copies(solid: Solid, parts: Sequence[_Rows]) -> Copies:
    def texts(name: str) -> Sequence[str]:
        columns = [getattr(rows, name) for rows in parts]
        return columns[0] if len(columns) == 1 else [*chain.from_iterable(columns)]

    def joined(name: str) -> Any:
        return np.concatenate([getattr(rows, name) for rows in parts])

    place = joined("places"), joined("turns"), joined("sizes")
    return Copies(solid, *place, joined("color"), texts("names"), texts("owners"))


def _ground(raster: Raster, cells: Any, cell: float) -> Generator[tuple[Solid, Color]]:
    """A ground as a solid of each colour, by the height in the middle of its triangles."""
    points, triangles = ground(cells, cell)
    heights = 100.0 * points[:, 2][triangles].mean(axis=1)
    ends = [*(least for least, _ in raster.colors[1:]), np.inf]
    for (least, color), end in zip(raster.colors, ends, strict=True):
        shown = triangles[(heights >= least) & (heights < end)]
        if color and len(shown):
            yield solid_of(points, shown), rgb(color)


def _squares(raster: Raster, cells: Any, cell: float) -> Generator[tuple[Solid, Color]]:
    """A poster as a solid of each colour: a rectangle for each run of equal squares."""
    rows, columns = np.shape(cells)
    numbers = color_ranges(np.asarray(cells), raster.colors)
    for number, (_, color) in enumerate(raster.colors, start=1):
        row, column, down, right = mask_rectangles(numbers == number).T
        if not color or not len(row):
            continue
        left, above = (column - columns / 2) * cell, (rows / 2 - row) * cell
        beyond, below = left + right * cell, above - down * cell
        corners = [(left, below), (beyond, below), (beyond, above), (left, above)]
        points = np.stack([np.column_stack((0.0 * y, y, z)) for y, z in corners], axis=1)
        first = 4 * np.arange(len(row), dtype=np.uint32)[:, None, None]
        faces = first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
        yield solid_of(points.reshape(-1, 3), faces.reshape(-1, 3)), rgb(color)
