"""θ, the view of an agent (equation 4), and π, the view of a string (equation 5)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns, has_columns, packed, rewritten
from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.events import AnyEvent, Event, single
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    Node,
    Scene,
    agents,
    checked_string,
    rescoped,
    with_scope,
)
from minerva_bus.grammar.traversal import identities
from minerva_bus.world.addressing import Addressed, addressed
from minerva_bus.world.agent import Agent
from minerva_bus.world.kinds import ActivityError, Kinds, kinds_of
from minerva_bus.world.population_views import returned, view_of_population


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
        result = returned(show(cls.thaw(node), event))
        left = next(agents(result, shown), None)
        if left is not None:
            raise MisuseError(f"a view is a string of L(E): {left.symbol}#{left.id} is an agent")
        return result
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ActivityError(show, node, event, frame) from error
