"""π of agents in columns (equation 5), computed for all agents at once."""

from __future__ import annotations

from typing import cast

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns, Rows, has_columns
from minerva_bus.grammar.condition import holds_of_many
from minerva_bus.grammar.events import Event, Events
from minerva_bus.grammar.scene import EMPTY, AgentNode, Scene, agents
from minerva_bus.world.addressing import Addressed
from minerva_bus.world.agent import Agent
from minerva_bus.world.kinds import ActivityError
from minerva_bus.world.population import Population, PopulationState


def view_of_population(
    part: Columns, addressed: Addressed, cls: type[Agent], frame: int
) -> Scene | None:
    """The views of agents in columns, or None if they must be visualized one by one.

    One call suffices for a single event to all agents and a method for populations, or a compiled
    one. Raises ActivityError.
    """
    concerning = [event for event in addressed.events if event.type in cls.views]
    if not concerning:
        return EMPTY
    event = concerning[0]
    # Otherwise agents may have different numbers of views, or the method shows one agent only.
    if len(concerning) > 1 or isinstance(event, Events) or event.receivers:
        return None
    accelerator, view = cls.accelerator, cls.population_views.get(event.type)
    if view is None and (accelerator is None or event.type not in accelerator.views):
        return None
    rows = _willing(part, event)
    count = part.count if rows is None else len(rows)
    if not count:
        return EMPTY
    state = PopulationState(part, cls.kind.fields, lasting=False)
    if view is None:
        assert accelerator is not None
        return accelerator.view(state, np.arange(count) if rows is None else rows, event)
    try:
        return one_each(view(Population(state, cls, rows), event), count)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        node = cast("AgentNode", part.node(0 if rows is None else int(rows[0])))
        raise ActivityError(view, node, event, frame) from error


def _willing(part: Columns, event: Event) -> Rows | None:
    if not event.condition:
        return None
    state = {name: column.array for name, column in zip(part.names, part.columns, strict=True)}
    willing = holds_of_many(event.condition, state, part.count)
    return None if willing.all() else np.flatnonzero(willing)


def returned(shown: object) -> Scene:
    """The result of a view method, if it is a string. Raises TypeError."""
    if shown is None:
        raise TypeError("a view returns a string, not None; to show nothing, return EMPTY")
    if not isinstance(shown, Scene):
        raise TypeError(
            f"a view returns a string, not {shown!r:.200}; call a primitive once and a"
            " transformation twice to get a string"
        )
    return shown


def one_each(result: object, count: int) -> Scene:
    """A string with a node for each of `count` agents, or with equal nodes for all."""
    shown = returned(result)
    left = next(agents(shown), None)
    if left is not None:
        raise MisuseError(f"a view is a string of L(E): {left.symbol}#{left.id} is an agent")
    pieces = shown.pieces
    if not pieces:
        return EMPTY
    if not has_columns(shown):
        return Scene(pieces * count)
    if any(piece.count != count for piece in pieces):
        raise MisuseError(
            f"the view of a population has a node for each of its {count} agents, not"
            f" {sorted({piece.count for piece in pieces})}"
        )
    if len(pieces) == 1:
        return shown
    # Equation 5 keeps the nodes of one agent together: first all nodes of the first agent, then
    # those of the next one, not one column after another.
    each = [piece.nodes() for piece in pieces]
    return Scene(tuple([node for row in zip(*each, strict=True) for node in row]))
