"""Bounding boxes of solids (section 5 of the paper), as `volumes` are those of the plane."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minerva_bodies.forms import DYNAMIC, MATERIAL
from minerva_bodies.geometry import SpaceGeometry
from minerva_bodies.meshes import ground, load_mesh
from minerva_bodies.rigid import Rigid
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.services import View

Core: TypeAlias = tuple[NDArray[np.float64], float, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class BoundingBox:
    """The smallest box along the axes of the world that contains a solid.

    Attributes:
        owner: id of the agent whose solid it is; "" for scenery.
        symbol: the primitive.
        lower: least x, y and z, metres.
        upper: largest x, y and z, metres.

    """

    owner: str
    symbol: str
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


def bounding_boxes(view: View, vocabulary: Vocabulary, who: str = "who") -> list[BoundingBox]:
    """The box of each solid of a view, in the order of the string.

    A mesh that moves is the convex hull of its points, as in physics. `who` is the name of the
    parameter with the id of an owner. Raises BodiesError for anything that cannot stand as the view
    shows it.
    """
    geometry = BoundsGeometry(vocabulary, who=who)
    geometry.read(view)
    return geometry.boxes


class BoundsGeometry(SpaceGeometry):
    """φ whose α also gives the box of a solid."""

    def _clear(self) -> None:
        super()._clear()
        self.boxes: list[BoundingBox] = []

    def solid(self, form: str, owner: str, figure: FigureNode, values: list[Any]) -> None:
        super().solid(form, owner, figure, values)
        moves = bool(owner) and values[3] == DYNAMIC
        self.bound(owner, figure.symbol, core_of(form, values[MATERIAL:], moves), self.pose)

    def bound(self, owner: str, symbol: str, core: Core, pose: Rigid) -> None:
        """Add the box of a solid at a pose."""
        points, ball, disc = core
        placed = np.column_stack(pose.turned(*points.T))
        placed += (pose.x, pose.y, pose.z)
        # A disc extends along an axis of the world by the sine of the angle to its own axis.
        along = np.array(pose.turned(0.0, 0.0, 1.0))
        sines = np.sqrt(np.maximum(0.0, 1.0 - along * along))
        margin = ball + np.multiply.outer(disc, sines)
        lower, upper = (placed - margin).min(axis=0), (placed + margin).max(axis=0)
        box = BoundingBox(owner, symbol, tuple(lower.tolist()), tuple(upper.tolist()))
        self.boxes.append(box)


def core_of(form: str, sizes: list[Any], moves: bool) -> Core:
    """Points (n, 3) of a solid, and the radii of a ball and of discs across z around them (n,)."""
    ball, discs = 0.0, list[float]()
    points: ArrayLike
    if form == "mesh":
        corners, triangles = load_mesh(str(sizes[0]))
        points = (corners if moves else corners[np.unique(triangles)]) * sizes[1]
    elif form == "terrain":
        points = ground(*sizes)[0]
    elif form == "box":
        points = [*product(*((-size, size) for size in sizes))]
    elif form == "ball":
        points, ball = [(0.0, 0.0, 0.0)], sizes[0]
    else:
        half, radius = sizes
        points = [(0.0, 0.0, -half), (0.0, 0.0, half)]
        if form == "capsule":
            ball = radius
        else:
            discs = [radius, 0.0 if form == "cone" else radius]
    placed = np.asarray(points, np.float64)
    return placed, ball, np.array(discs) if discs else np.zeros(len(placed))
