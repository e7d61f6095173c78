"""The geometric system of sounds: what a string means to a listener.

α    a voice sounds at its position; an aim affects the voices near it
β δ  transformations move sources, as in any planar geometry
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.bounds import BoundingGeometry
from minerva_bus.semantics.plane import Pose
from minerva_services.views.sound.roles import SoundRoles, name_of, plays

_LEAST_SETBACK = 0.005
"""Minimum setback in metres; less may be rounding."""


@dataclass(frozen=True, slots=True)
class Voice:
    """A figure that sounds, and its distance to the nearest aim (m; inf without one)."""

    at: Pose
    distance: float

    def is_set_back_from(self, before: Pose) -> bool:
        """True if it is behind its previous position.

        A figure with a heading drives forward. It moves behind itself only when evolution takes
        back part of a move: that is how a collision shows in a view.
        """
        ahead = math.radians(before.angle)
        along = math.cos(ahead) * (self.at.x - before.x) + math.sin(ahead) * (self.at.y - before.y)
        return along < -_LEAST_SETBACK


class SoundGeometry(BoundingGeometry):
    """Collects the voices of a string of L(E) and their positions."""

    def __init__(self, vocabulary: Vocabulary, roles: SoundRoles) -> None:
        super().__init__(vocabulary)
        self._roles = roles
        self._poses: dict[str, Pose] = {}
        self._aims: list[tuple[float, float]] = []

    def other_figure(self, figure: FigureNode) -> None:
        """α: a primitive may sound without being drawn."""
        if plays(figure, self._roles.voices):
            self._poses[self._name(figure)] = self.pose
        elif plays(figure, self._roles.aims):
            self._aims.append((self.pose.x, self.pose.y))
        super().other_figure(figure)

    def voices(self) -> dict[str, Voice]:
        """The voices of the string by name, in order."""
        return {name: Voice(at, self._distance(at)) for name, at in self._poses.items()}

    def side(self, at: Pose) -> float:
        """Horizontal position: 0 at the left edge of everything drawn, 1 at the right edge."""
        if self.bounds is None or self.bounds.right <= self.bounds.left:
            return 0.5
        width = self.bounds.right - self.bounds.left
        return min(1.0, max(0.0, (at.x - self.bounds.left) / width))

    def _name(self, figure: FigureNode) -> str:
        """The figure's name, or its number among the voices."""
        name = name_of(figure)
        return name if "#" in name else f"{name}#{len(self._poses)}"

    def _distance(self, at: Pose) -> float:
        return min((math.dist((at.x, at.y), aim) for aim in self._aims), default=math.inf)
