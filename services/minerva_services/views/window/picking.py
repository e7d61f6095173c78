"""Picking: the agent or label under the mouse."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from minerva_services.geometry.picture import Copies, Discs, Picture
from minerva_services.views.window.painter import Box, Floats

Projection: TypeAlias = Callable[[Floats, Floats, Floats], tuple[Floats, Floats, Floats]]
TOLERANCE = 5.0
"""Tolerance in pixels around a disc."""


@dataclass(frozen=True, slots=True)
class Hit:
    """An agent's id, or a label's text."""

    agent: str = ""
    label: str = ""


def pick(
    picture: Picture, project: Projection, labels: Sequence[Box], at: tuple[float, float]
) -> Hit | None:
    """What is at a pixel: agents before labels; the nearest agent, the topmost label."""
    agent = _agent(picture, project, at)
    if agent:
        return Hit(agent=agent)
    x, y = at
    for box in reversed(labels):
        if box.left <= x <= box.right and box.top <= y <= box.bottom:
            return Hit(agent=box.text) if box.names_agent else Hit(label=box.text)
    return None


def _agent(picture: Picture, project: Projection, at: tuple[float, float]) -> str:
    best, agent = float("inf"), ""
    for things in picture.items:
        if isinstance(things, Discs) and len(things):
            x, y, scale = project(things.x, things.y, things.height / 2)
            radius = things.radius
        elif isinstance(things, Copies):
            low, high = things.extents()
            x, y, scale = project(*((low + high) / 2).T)
            radius = (high - low).max(axis=1) / 2
        else:
            continue
        away = np.hypot(x - at[0], y - at[1])
        with np.errstate(invalid="ignore"):
            # Things behind the camera are NaN, for which the comparison is false.
            touched = away <= radius * scale + TOLERANCE
        for row in np.flatnonzero(touched)[np.argsort(away[touched], kind="stable")]:
            # Rows are in ascending distance.
            if away[row] >= best:
                break
            if things.agent(int(row)):
                best, agent = float(away[row]), things.agent(int(row))
                break
    return agent


@dataclass(frozen=True, slots=True)
class Spot:
    """Where an agent is displayed: metres and degrees; `radius` (m) of its disc."""

    x: float
    y: float
    angle: float
    radius: float


def spots_of(picture: Picture, agents: Collection[str]) -> dict[str, Spot]:
    """Positions of agents: the first disc with a heading, otherwise the first disc or solid."""
    spots: dict[str, Spot] = {}
    headed: set[str] = set()
    for discs in picture.of(Discs) if agents else ():
        for row, agent in _rows(discs, agents):
            heads = bool(discs.heading[row])
            if agent not in spots or (heads and agent not in headed):
                place = discs.x[row], discs.y[row], discs.angle[row], discs.radius[row]
                spots[agent] = Spot(*map(float, place))
                headed |= {agent} if heads else set()
    for copies in picture.of(Copies) if agents else ():
        for row, agent in _rows(copies, agents):
            if agent not in spots:
                low, high = (edge[row] for edge in copies.extents())
                (x, y), radius = ((low + high) / 2)[:2].tolist(), float((high - low)[:2].max()) / 2
                spots[agent] = Spot(x, y, 0.0, radius)
    return spots


def spot_of(picture: Picture, agent: str) -> Spot | None:
    """Position of an agent; None if it is not displayed."""
    return spots_of(picture, (agent,)).get(agent) if agent else None


def _rows(things: Discs | Copies, agents: Collection[str]) -> Iterator[tuple[int, str]]:
    for row, (owner, name) in enumerate(zip(things.owners, things.names, strict=True)):
        # The fragment of a population begins with ~; its agents have names of their own.
        agent = name if owner.startswith("~") else owner
        if agent in agents:
            yield row, agent


def first_agent(picture: Picture) -> str:
    """The first agent with a heading; "" if there is none."""
    for discs in picture.of(Discs):
        for row in np.flatnonzero(discs.heading):
            if discs.agent(int(row)):
                return discs.agent(int(row))
    return ""
