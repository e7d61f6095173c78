"""Halo: how far a service looks around the figures in its views, and what it saves of agents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Final

from numpy.typing import NDArray

from minerva_bus.grammar.ids import Ids


@dataclass(frozen=True, slots=True)
class Halo:
    """What a service sends an agent depends on figures within a radius of that agent's figure only.

    Its events have one receiver each, an agent with a figure in the view. So a world in regions may
    show each instance of the service a part of the view: the agents of its region, and others that
    are near them. With the radius `inf`, each region sees all figures, wherever they are, and their
    coordinates do not matter; what is divided is the work for each agent.

    Readings that it publishes about an agent stay in the region, for generators that have a halo,
    too: `OWN_READINGS`, if what they send an agent depends on its own readings only.

    A device that saves data saves `{"agents": agent_lines({id: text}), NAME: NUMBER, ...}`. The
    text of an agent moves with the agent to another region, by `save` and `restore`; numbers belong
    to all regions together, which add them up.

    Args:
        radius: of the circle, or half of a side of the square, in the units of the coordinates;
            `inf` for all figures.
        x: name of the x coordinate in the view.
        y: name of the y coordinate in the view.
        who: name of the agent's id in the view.
        size: width and height of a plane whose opposite edges are connected, or None.
        scenery: whether figures outside of agents count, which all regions then see, wherever they
            are; without it, figures without an id do not count.
        figure: the primitive that has the id; "": any. For the radius `inf` only.
        kept: whether the device also needs what other instances have saved of the agents that it
            only sees; it then finds that in `others`, by id.

    """

    radius: float
    x: str = "x"
    y: str = "y"
    who: str = "who"
    size: tuple[float, float] | None = None
    scenery: bool = False
    figure: str = ""
    kept: bool = False

    @property
    def everywhere(self) -> bool:
        """Whether all figures count, wherever they are."""
        return self.radius == inf

    def joined(self, other: Halo) -> Halo | None:
        """The halo of both devices, if they draw the same views; None if their planes differ."""
        radius, scenery = max(self.radius, other.radius), self.scenery or other.scenery
        both = replace(self, radius=radius, scenery=scenery, kept=self.kept or other.kept)
        same = replace(other, radius=radius, scenery=scenery, kept=both.kept) == both
        return both if same else None


OWN_READINGS: Final = Halo(inf)
"""The halo of a generator without views that sends each agent what its own readings show."""


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
