"""Checks replies of hosts: a host may only report on the requested fragments."""

from __future__ import annotations

from collections.abc import Callable, Collection, Container
from operator import itemgetter
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.views import patch_all
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import AgentNode, Scene, agents

_AGENT: Final[Callable[[tuple[str, str]], str]] = itemgetter(0)


def patched(reply: m.EvolveReply, composition: Composition) -> dict[str, Scene]:
    """The changed fragments of a reply, with deltas applied. Raises Unfit."""
    changed, fragments = dict(reply.changed), composition.fragments
    # A host that declines columns returns a part node by node; the composition holds columns.
    for name in sorted(changed.keys() & composition.parts.keys()):
        changed[name] = packed(changed[name])
    if reply.patched:
        former = {name: Scene((fragments[name],)) for name in reply.patched if name in fragments}
        patch_all(former, reply.patched)
        changed |= former
    return changed


def foreign_fragment(reply: m.EvolveReply, asked: Collection[str]) -> str:
    """Reason for rejecting a reply about fragments that were not requested, or empty."""
    named = set(reply.changed).union(reply.patched, *reply.views.values())
    for fragment in sorted(named.union(*reply.view_patches.values()).difference(asked)):
        return f"it answered for #{fragment}, not its own"
    return ""


def foreign_sender(
    name: str,
    events: tuple[AnyEvent, ...],
    senders: Container[str],
    asked: Collection[str],
    composition: Composition,
) -> str:
    """Reason for rejecting events sent by an agent or a fragment of others, or empty.

    `senders` are the ids under which the agent may send.
    """
    part = composition.parts.get(name)
    # A host reports events by the agent, or by the name of a part for agents in columns.
    if (name if part is not None else composition.home(name)) not in asked:
        return f"it sent events of #{name}, not its own"
    if not all(_is_from(event, senders, part) for event in events):
        return f"it sent events of #{name} in another's name"
    return ""


def duplicate_agent(
    reply: m.EvolveReply, newborns: dict[str, str], composition: Composition
) -> str:
    """Reason for rejecting a reply with an agent of another fragment, or empty.

    `newborns` are the fragments of agents in earlier replies; those of this reply are added.
    """
    reported: list[tuple[str, str]] = []
    for fragment, scene in sorted(reply.changed.items()):
        # Outside columns, whose ids `Composition.replace` checks together.
        for piece in scene.pieces:
            # The usual case, without a stack for each agent.
            if isinstance(piece, AgentNode) and not piece.scope.pieces:
                reported.append((piece.id, fragment))
            elif piece.ids is None:
                reported += [(agent.id, fragment) for agent in agents(Scene((piece,)))]
    # An agent may be in another fragment already: in the string, or in an earlier reply, where it
    # may have moved to.
    known = composition.home_of_each(map(_AGENT, reported)) | newborns
    for agent, fragment in reported:
        if known.setdefault(agent, fragment) != fragment:
            return f"it made a second agent #{agent}"
    newborns.update(reported)
    return ""


def _is_from(event: AnyEvent, senders: Container[str], part: Columns | None) -> bool:
    if part is None or part.ids is None:
        return isinstance(event, Event) and event.sender in senders
    if isinstance(event, Event):
        return part.ids.row_of(event.sender) >= 0
    return event.senders is not None and bool((part.ids.rows_of(event.senders) >= 0).all())
