"""θ, the view of an agent (equation 4), and π, the view of a string (equation 5)."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import cast

import numpy as np

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns, Rows, has_columns, packed, rewritten
from minerva_bus.grammar.condition import holds, holds_of_many
from minerva_bus.grammar.events import AnyEvent, Event, Events, single
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    Node,
    Scene,
    agents,
    checked_string,
    identities,
    rescoped,
    with_scope,
)
from minerva_bus.world.agent import ActivityError, Agent, Kinds, kinds_of
from minerva_bus.world.event_collection import Addressed, addressed
from minerva_bus.world.population import Population, PopulationState


def visualize(
    scene: Scene,
    events: Sequence[AnyEvent] | Addressed,
    kinds: Iterable[type[Agent]] | Kinds,
    frame: int = 0,
) -> Scene:
    """π(w, e^v), equation 5: the string of L(E) that represents w for the visual events.

    The view of an agent whose kind has no method for any of the events is ε.

    Args:
        scene: w, checked by its vocabulary.
        events: events of visual types.
        kinds: agent classes.
        frame: number of the frame, for errors.

    Raises:
        ActivityError: code of an agent fails.
        MisuseError: an argument is of a wrong type.

    Example:
        >>> print(visualize(Fox("f1", x=2.0).string, [ePicture()], [Fox]))
        TAt<x=2, y=0>(PSnail)

    """
    checked_string(scene)
    concerning = addressed(events)
    classes = kinds_of(kinds)

    def leave(node: Node, scope: Scene) -> Scene | Node:
        if not isinstance(node, AgentNode):
            return rescoped(node, scope)
        cls = classes.get(node.symbol)
        if cls is None:
            return EMPTY
        result = EMPTY
        # Equation 5: the scope is visualized first, so θ has the views of the agents within.
        for event in single(event for _, event in concerning.to(node.id, cls.views)):
            node = with_scope(node, scope)
            if not event.condition or holds(event.condition, node.state):
                result += _view(cls, node, event, frame)
        return result

    def whole(part: Columns) -> Scene | None:
        if part.ids is None:
            return Scene((part,))
        cls = classes.get(part.symbol)
        return EMPTY if cls is None else view_of_population(part, concerning, cls, frame)

    shown = rewritten(scene, leave, whole)
    # Packed only beside columns, so that views of few single agents skip the search for runs.
    return packed(shown) if has_columns(scene) else shown


def _view(cls: type[Agent], node: AgentNode, event: Event, frame: int) -> Scene:
    """θ(a, e), equation 4."""
    shown = identities(node.scope)  # skipped: already of L(E), and possibly very deep
    show = cls.views[event.type]
    try:
        return returned(show(cls.thaw(node), event), shown)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ActivityError(show, node, event, frame) from error


def view_of_population(
    part: Columns, addressed: Addressed, cls: type[Agent], frame: int
) -> Scene | None:
    """The views of agents in columns, or None if they must be visualized one by one.

    One call suffices for a single event to all agents and a method for populations. Raises
    ActivityError.
    """
    concerning = [event for event in addressed.events if event.type in cls.views]
    if not concerning:
        return EMPTY
    event = concerning[0]
    # Otherwise agents may have different numbers of views, or the method shows one agent only.
    if len(concerning) > 1 or isinstance(event, Events) or event.receivers:
        return None
    view = cls.population_views.get(event.type)
    if view is None:
        return None
    rows = _willing(part, event)
    count = part.count if rows is None else len(rows)
    if not count:
        return EMPTY
    state = PopulationState(part, cls.kind.fields, lasting=False)
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


def returned(shown: object, skipped: Container[int] = ()) -> Scene:
    """The result of a view method, if it is a string of L(E), except for the skipped nodes.

    Raises TypeError for another object, and MisuseError for a string with an agent.
    """
    if shown is None:
        raise TypeError("a view returns a string, not None; to show nothing, return EMPTY")
    if not isinstance(shown, Scene):
        raise TypeError(
            f"a view returns a string, not {shown!r:.200}; call a primitive once and a"
            " transformation twice to get a string"
        )
    left = next(agents(shown, skipped), None)
    if left is not None:
        raise MisuseError(f"a view is a string of L(E): {left.symbol}#{left.id} is an agent")
    return shown


def one_each(result: object, count: int) -> Scene:
    """A string with a node for each of `count` agents, or with equal nodes for all."""
    shown = returned(result)
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
