"""Names of agents in a picture: a label at each agent that has a heading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minerva_services.geometry.picture import Discs, Picture

MAX_NAMES = 24
"""Number of agents from which no names are shown: they would cover the picture."""


@dataclass(frozen=True, slots=True)
class AgentName:
    """An agent's name at its disc: position, radius and height in metres."""

    text: str
    x: float
    y: float
    radius: float
    height: float


def agent_names(picture: Picture) -> tuple[AgentName, ...]:
    """The names of all agents with a heading, at their first disc; none if there are too many."""
    names: dict[str, AgentName] = {}
    for discs in picture.of(Discs):
        for row in np.flatnonzero(discs.heading):
            agent = discs.agent(int(row))
            if not agent or agent in names:
                continue
            if len(names) == MAX_NAMES:
                return ()
            place = discs.x[row], discs.y[row], discs.radius[row], discs.height[row]
            names[agent] = AgentName(agent, *map(float, place))
    return tuple(names.values())
