"""A geometric system of the plane that knows symbols by their forms only; bounds of a string."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.grammar.appearance import Disc, Line, Measure, Motion, Raster, Shape
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import FigureNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import Geometry, interpret
from minerva_bus.semantics.poses import Point, Pose

Floats: TypeAlias = NDArray[np.float64]


def resolve(measure: Measure, parameters: Mapping[str, Any]) -> float:
    """The number of a form's measure: itself, or the value of the parameter that it names."""
    return float(parameters[measure]) if isinstance(measure, str) else measure


def resolve_all(measure: Measure, level: Columns) -> Floats:
    """The number of a form's measure in each row of a level of columns; shape (n,)."""
    if isinstance(measure, str):
        return np.asarray(level.column(measure), np.float64)
    return np.full(level.count, float(measure))


def after(motion: Motion, parameters: Mapping[str, Any], at: Pose) -> Pose:
    """The pose to which a motion with these parameters leads."""
    return at.then(
        resolve(motion.x, parameters),
        resolve(motion.y, parameters),
        resolve(motion.turn, parameters),
        resolve(motion.forward, parameters),
    )


def raster_corner(raster: Raster, parameters: Mapping[str, Any], at: Pose) -> Pose:
    """The pose of the corner of a raster's cell (0, 0)."""
    return after(Motion(raster.x, raster.y, raster.turn), parameters, at)


def outline(shape: Shape, parameters: Mapping[str, Any], at: Pose) -> tuple[list[Point], float]:
    """Points in metres and a margin around them that contain all that a shape draws.

    The centre of a disc and its radius, the points of a line and half its width, the corners of a
    raster, the position of a label; nothing for a label that only marks others.
    """
    if isinstance(shape, Disc):
        return [(at.x, at.y)], resolve(shape.radius, parameters)
    if isinstance(shape, Line):
        points = zip(parameters[shape.xs], parameters[shape.ys], strict=False)
        return [at.point(x, y) for x, y in points], shape.width / 2
    if isinstance(shape, Raster):
        corner, cell = raster_corner(shape, parameters, at), resolve(shape.cell, parameters)
        rows, columns = parameters[shape.cells].shape
        return [corner.point(x, y) for x in (0.0, rows * cell) for y in (0.0, columns * cell)], 0.0
    return [] if shape.marks else [(at.x, at.y)], 0.0


class PlaneGeometry(Geometry):
    """A geometry in which transformations move a pose in the plane by their motions."""

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
        return self._moved(self._motion(transformation.symbol), transformation.parameters)

    def _motion(self, symbol: str) -> Motion:
        declared = self.vocabulary.transformations.get(symbol)
        return (declared.motion if declared is not None else None) or Motion()

    @contextmanager
    def _moved(self, motion: Motion, parameters: Mapping[str, Any]) -> Generator[None]:
        before = self.pose
        self.pose = after(motion, parameters, before)
        yield
        # Restored, because the inverse motion would differ by rounding.
        self.pose = before

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        """α of a primitive with a shape, at `self.pose`."""

    def poses(self, levels: Sequence[Columns], count: int) -> tuple[Floats, Floats, Floats]:
        """Poses to which a chain of transformations in columns leads: x, y (m), angle (deg), (n,).

        Equal to the last bit to `Pose.then` of each row, because a string in columns and the same
        string in nodes must have the same views.
        """
        at = self.pose
        x, y, angle = np.full(count, at.x), np.full(count, at.y), np.full(count, at.angle)
        for level in levels:
            motion = self._motion(level.symbol)
            dx, dy = resolve_all(motion.x, level), resolve_all(motion.y, level)
            cos, sin = _direction(angle, dx, dy)
            # Each step rounds in the same places as `Pose.then`.
            x, y = x + dx * cos - dy * sin, y + dx * sin + dy * cos
            angle = angle + resolve_all(motion.turn, level)
            forward = resolve_all(motion.forward, level)
            cos, sin = _direction(angle, forward, forward)
            x, y = x + forward * cos, y + forward * sin
        return x, y, angle


def _direction(angle: Floats, along: Floats, across: Floats) -> tuple[Floats, Floats]:
    """Cosine and sine of angles, or of 0 where nothing moves by them."""
    # Most motions of a population have no angle or no length, and two sines cost more than a check.
    if not angle.any() or not (along.any() or across.any()):
        return np.ones(len(angle)), np.zeros(len(angle))
    return portable.cos_sin(np.radians(angle))


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
