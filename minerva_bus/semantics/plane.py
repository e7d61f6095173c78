"""A geometric system of the plane that knows symbols by their forms only.

`PlaneGeometry` keeps where the string's transformations have led to and hands each primitive's
shape, with its measures resolved, to `shape`. Pictures, windows and bounds derive from it.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.forms import Measure, Motion, Shape
from minerva_bus.grammar.scene import FigureNode, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import Geometry

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose:
    """A place in the plane: metres, and degrees counter-clockwise from the x axis."""

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0

    def then(self, x: float, y: float, turn: float, forward: float) -> Pose:
        """Shift by (x, y) in this pose's own axes, turn, and go forward."""
        cos, sin = portable.cos(math.radians(self.angle)), portable.sin(math.radians(self.angle))
        angle = self.angle + turn
        ahead = math.radians(angle)
        return Pose(
            self.x + x * cos - y * sin + forward * portable.cos(ahead),
            self.y + x * sin + y * cos + forward * portable.sin(ahead),
            angle,
        )


def resolve(measure: Measure, parameters: Mapping[str, Any]) -> float:
    """A form's measure: the number itself, or the value of the parameter that it names."""
    return float(parameters[measure]) if isinstance(measure, str) else measure


def resolve_all(measure: Measure, level: Columns) -> Floats:
    """A form's measure for each row of a level of columns; shape (n,)."""
    if isinstance(measure, str):
        return np.asarray(level.column(measure), np.float64)
    return np.full(level.count, float(measure))


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

    def poses(self, levels: Sequence[Columns], count: int) -> tuple[Floats, Floats, Floats]:
        """Where a chain of transformations in columns leads: x, y (m) and angle (deg), by row.

        To the last bit where each row by itself would lead.
        """
        at = self.pose
        x, y, angle = np.full(count, at.x), np.full(count, at.y), np.full(count, at.angle)
        for level in levels:
            declared = self.vocabulary.transformations.get(level.symbol)
            motion = (declared.motion if declared is not None else None) or Motion()
            dx, dy = resolve_all(motion.x, level), resolve_all(motion.y, level)
            cos, sin = _direction(angle, dx, dy)
            x, y = x + dx * cos - dy * sin, y + dx * sin + dy * cos
            angle = angle + resolve_all(motion.turn, level)
            forward = resolve_all(motion.forward, level)
            cos, sin = _direction(angle, forward, forward)
            x, y = x + forward * cos, y + forward * sin
        return x, y, angle


def _direction(angle: Floats, along: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Cosine and sine, where a way along or across them is not 0."""
    if not angle.any() or not (along.any() or across.any()):
        return np.ones(len(angle)), np.zeros(len(angle))
    turns = np.radians(angle)
    return portable.cos(turns), portable.sin(turns)
