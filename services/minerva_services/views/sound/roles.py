"""Which primitives of a world are voices, and which are their aims."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.forms import Disc
from minerva_bus.grammar.scene import FigureNode
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
        raise MisuseError(
            f"sound: no disc of the world {world.world!r} has a heading; set voice to one of"
            f" {', '.join(sorted(world.vocabulary.primitives)) or 'no primitives'}"
        )
    aimed = _known(world, "aim", aims) or _goals(world) or _discs(world, heading=False)
    return SoundRoles(named, aimed - named)


def _goals(world: WorldInfo) -> frozenset[str]:
    return frozenset({GOAL} & world.vocabulary.primitives.keys())


def _known(world: WorldInfo, option: str, names: Collection[str]) -> frozenset[str]:
    known = world.vocabulary.primitives
    for name in names:
        symbol = name.partition("#")[0]
        if symbol not in known:
            raise MisuseError(
                f"sound: {option} is {name!r}, but the world {world.world!r} has no such"
                f" primitive{nearest(symbol, list(known))}; it has {', '.join(sorted(known))}"
            )
    return frozenset(names)


def _discs(world: WorldInfo, heading: bool) -> frozenset[str]:
    return frozenset(
        name
        for name, primitive in world.vocabulary.primitives.items()
        if isinstance(primitive.shape, Disc) and primitive.shape.heading is heading
    )
