"""The smallest upright rectangle around what a string draws, from its symbols' forms."""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.grammar.forms import Disc, Line, Raster, Shape
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry, Pose, resolve


@dataclass(frozen=True, slots=True)
class Bounds:
    """A rectangle, metres."""

    left: float
    bottom: float
    right: float
    top: float

    def around(self, other: Bounds) -> Bounds:
        """The smallest rectangle around both."""
        return Bounds(
            min(self.left, other.left),
            min(self.bottom, other.bottom),
            max(self.right, other.right),
            max(self.top, other.top),
        )


class BoundingGeometry(PlaneGeometry):
    """A geometric system whose action for a primitive is to grow a rectangle."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.bounds: Bounds | None = None

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        for pose, margin in _corners(shape, figure, self.pose):
            corner = Bounds(pose.x - margin, pose.y - margin, pose.x + margin, pose.y + margin)
            self.bounds = corner if self.bounds is None else self.bounds.around(corner)


def _corners(shape: Shape, figure: FigureNode, at: Pose) -> list[tuple[Pose, float]]:
    parameters = figure.parameters
    if isinstance(shape, Disc):
        return [(at, resolve(shape.radius, parameters))]
    if isinstance(shape, Line):
        points = zip(parameters[shape.xs], parameters[shape.ys], strict=False)
        return [(at.then(x, y, 0.0, 0.0), shape.width / 2) for x, y in points]
    if isinstance(shape, Raster):
        rows, columns = parameters[shape.cells].shape
        cell = resolve(shape.cell, parameters)
        corner = at.then(
            resolve(shape.x, parameters),
            resolve(shape.y, parameters),
            resolve(shape.turn, parameters),
            0.0,
        )
        ends = (
            (0.0, 0.0),
            (rows * cell, 0.0),
            (0.0, columns * cell),
            (rows * cell, columns * cell),
        )
        return [(corner.then(x, y, 0.0, 0.0), 0.0) for x, y in ends]
    return [(at, 0.0)]


def bounds(scene: Scene, vocabulary: Vocabulary) -> Bounds | None:
    """The rectangle around a string of L(E), or None where it draws nothing."""
    geometry = BoundingGeometry(vocabulary)
    interpret(scene, geometry)
    return geometry.bounds
