"""The geometric system of sounds: which figures of a string are voices, and which are their aims.

α    a voice sounds at its position; an aim affects the voices near it
β δ  transformations move sources, as in any planar geometry
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.appearance import Disc
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.plane import BoundingGeometry
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.services import WorldInfo

GOAL = "PGoal"
"""Default primitive of an agent's aim, in the robot's world and elsewhere."""


@dataclass(frozen=True, slots=True)
class SoundRoles:
    """Voices and aims: all figures of a symbol, as PRobot, or one by name, as PRobot#r1."""

    voices: frozenset[str]
    aims: frozenset[str]


def name_of(figure: FigureNode) -> str:
    """SYMBOL#NAME for a figure with the parameter `name`, otherwise its symbol."""
    name = figure.parameters.get("name")
    return f"{figure.symbol}#{name}" if isinstance(name, str) else figure.symbol


def plays(figure: FigureNode, part: Collection[str]) -> bool:
    """True if a figure belongs to a role."""
    return figure.symbol in part or name_of(figure) in part


def roles(world: WorldInfo, voices: Collection[str], aims: Collection[str]) -> SoundRoles:
    """The roles for these names.

    Without names, voices are all discs with a heading, and the aim is PGoal or, if the world has
    none, every disc without a heading.

    Raises MisuseError for unknown names, and if nothing would sound.
    """
    named = _known(world, "voice", voices) or _discs(world, heading=True)
    if not named:
        discs = sorted(_discs(world, heading=False) or world.vocabulary.primitives)
        raise MisuseError(
            f"no disc of the world {world.world!r} has a heading; choose what sounds with"
            f" the option voice, such as --view sound:voice={discs[0]}; there are"
            f" {', '.join(discs)}"
            if discs
            else f"the world {world.world!r} has no primitives that could sound"
        )
    aimed = _known(world, "aim", aims) or _goals(world) or _discs(world, heading=False)
    # A figure cannot be the aim of its own voice: its distance would always be 0.
    return SoundRoles(named, aimed - named)


def _goals(world: WorldInfo) -> frozenset[str]:
    return frozenset({GOAL} & world.vocabulary.primitives.keys())


def _known(world: WorldInfo, option: str, names: Collection[str]) -> frozenset[str]:
    known = world.vocabulary.primitives
    for name in names:
        symbol, is_named, _ = name.partition("#")
        if symbol not in known:
            hint = nearest(symbol, list(known), f"it has {', '.join(sorted(known))}")
            raise MisuseError(
                f"sound: {option} is {name!r}, but the world {world.world!r} has no such"
                f" primitive{hint}"
            )
        if is_named and "name" not in known[symbol].fields.names:
            raise MisuseError(
                f"sound: {option} is {name!r}, but {symbol} has no parameter `name`; use {symbol}"
            )
    return frozenset(names)


def _discs(world: WorldInfo, heading: bool) -> frozenset[str]:
    return frozenset(
        name
        for name, primitive in world.vocabulary.primitives.items()
        if isinstance(primitive.shape, Disc) and primitive.shape.heading is heading
    )


_MIN_SETBACK = 0.005
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
        return along < -_MIN_SETBACK


class SoundGeometry(BoundingGeometry):
    """Collects the voices of a string of L(E) and their positions."""

    def __init__(self, vocabulary: Vocabulary, roles: SoundRoles) -> None:
        super().__init__(vocabulary)
        self._roles = roles
        self._poses: dict[str, Pose] = {}
        self._aims: list[tuple[float, float]] = []
        self.names = set[str]()
        """Symbols and names of all figures."""

    def other_figure(self, figure: FigureNode) -> None:
        """α: a primitive may sound without being drawn."""
        self.names.add(name_of(figure))
        if plays(figure, self._roles.voices):
            self._poses[self._name(figure)] = self.pose
        elif plays(figure, self._roles.aims):
            self._aims.append((self.pose.x, self.pose.y))
        # For the bounds, within which voices are panned.
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
