"""Halo: how far a device looks around the figures in its views, and what it saves of agents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from minerva_bus.grammar.ids import Ids


@dataclass(frozen=True, slots=True)
class Halo:
    """What a device sends an agent depends on figures within a radius of that agent's figure only.

    Its events have one receiver each, an agent with a figure in the view. So a world in regions may
    show each instance of the device a part of the view: the agents of its region, and others that
    are near them.

    A device that saves data saves `{"agents": agent_lines({id: text}), NAME: NUMBER, ...}`. The
    text of an agent moves with the agent to another region, by `save` and `restore`; numbers belong
    to all regions together, which add them up.

    Args:
        radius: of the circle, or half of a side of the square, in the units of the coordinates.
        x: name of the x coordinate in the view.
        y: name of the y coordinate in the view.
        who: name of the agent's id in the view.
        size: width and height of a plane whose opposite edges are connected, or None.
        scenery: whether figures outside of agents count, which all regions then see, wherever they
            are; without it, figures without an id do not count.

    """

    radius: float
    x: str = "x"
    y: str = "y"
    who: str = "who"
    size: tuple[float, float] | None = None
    scenery: bool = False

    def joined(self, other: Halo) -> Halo | None:
        """The halo of both devices, if they draw the same views; None if their planes differ."""
        same = replace(self, radius=other.radius, scenery=other.scenery) == other
        radius = max(self.radius, other.radius)
        return replace(self, radius=radius, scenery=self.scenery or other.scenery) if same else None


@dataclass(frozen=True, slots=True, eq=False)
class OwnFigures:
    """The agents of a view for which a device answers in its region; arrays of shape (n,)."""

    ids: Ids
    x: NDArray[Any]
    y: NDArray[Any]


AGENTS = "agents"
"""The name of the agents' texts in the saved data of a device with a halo."""


def agent_lines(texts: Mapping[str, str]) -> str:
    """What a device has saved of each agent, one line each, sorted by id. Inverse: `by_agent`."""
    return "\n".join([f"{who}\t{text}" for who, text in sorted(texts.items())])


def by_agent(lines: str) -> dict[str, str]:
    """What a device has saved of each agent, by id. Raises ValueError for other texts."""
    pairs = [line.partition("\t") for line in lines.split("\n")] if lines else []
    if not all(who and tab for who, tab, _ in pairs):
        raise ValueError("a line without an id and a tab")
    return {who: text for who, _, text in pairs}
