"""One agent through the methods that are written for populations: a population of one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from minerva_bus.grammar.batch import Events
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import EMPTY, AgentNode, Scene
from minerva_bus.world.context import Context
from minerva_bus.world.declaring import TOGETHER
from minerva_bus.world.population import (
    BatchContext,
    EventBatch,
    Population,
    PopulationState,
    returns_nothing,
)

if TYPE_CHECKING:
    from minerva_bus.world.agent import Agent

Activity = Callable[[Any, Any, Any], Any]


def as_one(activity: Activity) -> Callable[[Any, Event, Context], Scene | None]:
    """λ of one agent from that of a population."""
    together: bool = getattr(activity, TOGETHER, False)

    def alone(agent: Agent, event: Event, moment: Context) -> Scene | None:
        herd, people = _population_of(agent)
        chances = moment.chance.as_many()
        given = EventBatch(Events.repeated(event, 1), np.zeros(1, np.intp)) if together else event
        moments = BatchContext(moment.frame, lambda: chances, people, None)
        returns_nothing(activity(people, given, moments))
        moment.chance.take(chances)
        for name, array in herd.arrays.items():
            setattr(agent, name, array.tolist()[0])
        for _, said in herd.said:
            for one in said:
                moment.emit(one)
        young = [node for birth in herd.born for node in birth.newborn.nodes()]
        if herd.away is not None:
            return Scene(tuple(young)) if young else EMPTY
        return agent.string + Scene(tuple(young)) if young else None

    alone.__wrapped__ = activity  # type: ignore[attr-defined]
    return alone


def view_as_one(view: Callable[[Any, Any], Any]) -> Callable[[Any, Event], Scene]:
    """θ of one agent from that of a population."""

    def alone(agent: Agent, event: Event) -> Scene:
        _, people = _population_of(agent)
        return view(people, event)

    alone.__wrapped__ = view  # type: ignore[attr-defined]
    return alone


def _population_of(agent: Agent) -> tuple[PopulationState, Population]:
    node = agent.freeze()
    bare = AgentNode(node.symbol, node.id, node.names, node.values)
    herd = PopulationState(Columns.of([bare]), agent.kind.fields)
    return herd, Population(herd, type(agent), None)
