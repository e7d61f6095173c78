"""Methods for populations applied to a single agent, as a population of one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event, Events
from minerva_bus.grammar.scene import EMPTY, AgentNode, Scene
from minerva_bus.world.context import Context
from minerva_bus.world.declaring import TOGETHER
from minerva_bus.world.event_batch import EventBatch
from minerva_bus.world.population import Population, PopulationState, returns_nothing

if TYPE_CHECKING:
    from minerva_bus.world.agent import Agent

Activity = Callable[[Any, Any, Any], Any]


def as_one(activity: Activity) -> Callable[[Any, Event, Context], Scene | None]:
    """λ of one agent from the λ of a population."""
    together: bool = getattr(activity, TOGETHER, False)

    def apply(agent: Agent, event: Event, moment: Context) -> Scene | None:
        state, population = _population_of(agent)
        given = EventBatch(Events.repeated(event, 1)) if together else event
        returns_nothing(activity(population, given, moment.batch(population)))
        for name, array in state.arrays.items():
            # As a Python object: attributes have exactly the types of the language, not those of
            # numpy.
            setattr(agent, name, array.tolist()[0])
        for _, sent in state.sent:
            for each in sent:
                moment.emit(each)
        young = [node for birth in state.born for node in birth.newborn.nodes()]
        # The agent has died; its newborns take its place.
        if state.away is not None:
            return Scene(tuple(young)) if young else EMPTY
        return agent.string + Scene(tuple(young)) if young else None

    apply.__wrapped__ = activity  # type: ignore[attr-defined]
    return apply


def view_as_one(view: Callable[[Any, Any], Any]) -> Callable[[Any, Event], Scene]:
    """θ of one agent from the θ of a population."""

    def apply(agent: Agent, event: Event) -> Scene:
        _, population = _population_of(agent)
        return view(population, event)

    apply.__wrapped__ = view  # type: ignore[attr-defined]
    return apply


def _population_of(agent: Agent) -> tuple[PopulationState, Population]:
    node = agent.freeze()
    # Columns hold agents without scopes, and methods for populations do not access the scope.
    bare = AgentNode(node.symbol, node.id, node.names, node.values)
    state = PopulationState(Columns.of([bare]), agent.kind.fields)
    return state, Population(state, type(agent), None)
