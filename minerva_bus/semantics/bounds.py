"""The smallest upright rectangle around all that a string draws, from its symbols' forms."""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.grammar.appearance import Shape
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry, outline


@dataclass(frozen=True, slots=True)
class Bounds:
    """An upright rectangle, metres."""

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
    """A geometric system in which each primitive extends a rectangle; None before the first."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.bounds: Bounds | None = None

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        points, margin = outline(shape, figure.parameters, self.pose)
        for x, y in points:
            corner = Bounds(x - margin, y - margin, x + margin, y + margin)
            self.bounds = corner if self.bounds is None else self.bounds.around(corner)


def bounds(scene: Scene, vocabulary: Vocabulary) -> Bounds | None:
    """The rectangle around a string of L(E), or None if it draws nothing."""
    geometry = BoundingGeometry(vocabulary)
    interpret(scene, geometry)
    return geometry.bounds
