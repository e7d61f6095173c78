"""A geometric system of the plane that knows symbols by their forms only.

`PlaneGeometry` keeps where the string's transformations have led to and hands each primitive's
shape, with its measures resolved, to `shape`. Pictures, windows and bounds derive from it.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

from minerva_bus.grammar.forms import Measure, Motion, Shape
from minerva_bus.grammar.scene import FigureNode, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import Geometry


@dataclass(frozen=True, slots=True)
class Pose:
    """A place in the plane: metres, and degrees counter-clockwise from the x axis."""

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0

    def then(self, x: float, y: float, turn: float, forward: float) -> Pose:
        """Shift by (x, y) in this pose's own axes, turn, and go forward."""
        cos, sin = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
        angle = self.angle + turn
        ahead = math.radians(angle)
        return Pose(
            self.x + x * cos - y * sin + forward * math.cos(ahead),
            self.y + x * sin + y * cos + forward * math.sin(ahead),
            angle,
        )


def resolve(measure: Measure, parameters: Mapping[str, Any]) -> float:
    """A form's measure: the number itself, or the value of the parameter that it names."""
    return float(parameters[measure]) if isinstance(measure, str) else measure


class PlaneGeometry(Geometry):
    """A geometry in which transformations move a pose about the plane, as their motions say."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.vocabulary = vocabulary
        self.pose = Pose()

    def other_figure(self, figure: FigureNode) -> None:
        primitive = self.vocabulary.primitives.get(figure.symbol)
        if primitive is not None and primitive.shape is not None:
            self.shape(primitive.shape, figure)

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        declared = self.vocabulary.transformations.get(transformation.symbol)
        motion = declared.motion if declared is not None else None
        return self._moved(motion or Motion(), transformation.parameters)

    @contextmanager
    def _moved(self, motion: Motion, parameters: Mapping[str, Any]) -> Generator[None]:
        before = self.pose
        self.pose = before.then(
            resolve(motion.x, parameters),
            resolve(motion.y, parameters),
            resolve(motion.turn, parameters),
            resolve(motion.forward, parameters),
        )
        yield
        self.pose = before

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        """α of a primitive with a shape, at `self.pose`."""
