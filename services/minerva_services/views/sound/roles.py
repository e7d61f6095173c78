"""Which primitives of a world are heard, and which ones are what they are after."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.forms import Disc
from minerva_bus.grammar.scene import FigureNode
from minerva_bus.world.services import WorldInfo

GOAL = "PGoal"
"""What the aim of agents is called, in the world of the robot and wherever else it is."""


@dataclass(frozen=True, slots=True)
class Roles:
    """Who is a voice and who an aim: all of a symbol, as PRobot, or one by name, as PRobot#r1."""

    voices: frozenset[str]
    aims: frozenset[str]


def name_of(figure: FigureNode) -> str:
    """SYMBOL#NAME for a figure with the parameter `name`, else its symbol."""
    name = figure.parameters.get("name")
    return f"{figure.symbol}#{name}" if isinstance(name, str) else figure.symbol


def plays(figure: FigureNode, part: Collection[str]) -> bool:
    """Whether a figure is among these."""
    return figure.symbol in part or name_of(figure) in part


def roles(world: WorldInfo, voices: Collection[str], aims: Collection[str]) -> Roles:
    """Those of these names.

    Without names, voices are all discs with a heading, and the aim is a PGoal or, where the world
    has none, any disc without a heading.

    Raises MisuseError for a name that the world does not have, and where nothing would be heard.
    """
    named = _known(world, "voice", voices) or _discs(world, heading=True)
    if not named:
        raise MisuseError(
            f"sound: no disc of the world {world.world!r} has a heading; set voice to what is to"
            f" be heard, of {', '.join(sorted(world.vocabulary.primitives)) or 'no primitives'}"
        )
    aimed = _known(world, "aim", aims) or _goals(world) or _discs(world, heading=False)
    return Roles(named, aimed - named)


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
