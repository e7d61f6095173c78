"""Checks replies of hosts: a host may only report on the requested fragments."""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Mapping
from operator import itemgetter
from typing import TYPE_CHECKING, Final

import numpy as np

from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Composition, first_in
from minerva_bus.frame.fragments import ids_of
from minerva_bus.frame.views import Views, patch_all
from minerva_bus.grammar.columns import Columns, packed
from minerva_bus.grammar.conversion import Unfit
from minerva_bus.grammar.events import AnyEvent, Event
from minerva_bus.grammar.ids import MAX_SHOWN, Ids, row_delta_of_ids
from minerva_bus.grammar.scene import AgentNode, Scene, agents

if TYPE_CHECKING:
    from minerva_bus.frame.in_flight import FrameResult

_AGENT: Final[Callable[[tuple[str, str]], str]] = itemgetter(0)


def checked(
    reply: m.EvolveReply, composition: Composition, views: Views, result: FrameResult
) -> dict[str, Scene]:
    """The changed fragments of a reply, with deltas applied; `result` has the earlier replies.

    Raises Unfit for whatever could prevent that the fragments of all replies form a string, and
    their views a view.
    """
    changed, fragments = dict(reply.changed), composition.fragments
    # A host that declines columns returns a part node by node; the composition holds columns.
    for name in sorted(changed.keys() & composition.parts.keys()):
        changed[name] = packed(changed[name])
    try:
        if reply.patched:
            former = {n: Scene((fragments[n],)) for n in reply.patched if n in fragments}
            patch_all(former, reply.patched)
            changed |= former
        for event_type, patches in reply.view_patches.items():
            views.check(event_type, patches)
    except Unfit as unfit:
        raise Unfit(f"it sent {unfit}, which do not match the string") from None
    # Last, because a refused reply claims nothing.
    twice = claim(changed, result, composition)
    if twice:
        raise Unfit(f"it made a second agent #{twice[:MAX_SHOWN]}")
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


def claim(changed: Mapping[str, Scene], result: FrameResult, composition: Composition) -> str:
    """Note the agents of changed fragments, each of which has no id twice.

    Returns an id that belongs to another fragment, by the string before the frame or by an earlier
    reply: then nothing is noted. Otherwise the text is empty.
    """
    single, gained = _reported(changed, composition.parts)
    homes = composition.home_of_each(map(_AGENT, single))
    owners = homes | result.newborns
    for agent, fragment in single:
        if owners.setdefault(agent, fragment) != fragment:
            return agent
    born = result.born.copy()
    if born:  # The owners are without them, because most frames have no need of their texts.
        gained += [(fragment, Ids.of([who])) for who, fragment in single if who not in homes]
    for fragment, ids in gained:
        others = [other for home, other in born if home != fragment]
        twice = composition.elsewhere(ids, fragment, owners) or first_in(ids, others)
        if twice:
            return twice
        born.append((fragment, ids))
    result.newborns.update(single)
    result.born = born
    return ""


def _reported(
    changed: Mapping[str, Scene], parts: Mapping[str, Columns]
) -> tuple[list[tuple[str, str]], list[tuple[str, Ids]]]:
    """The agents outside columns and the ids that columns have gained, with their fragments."""
    single, gained = list[tuple[str, str]](), list[tuple[str, Ids]]()
    for fragment, scene in sorted(changed.items()):
        for piece in scene.pieces:
            if piece.ids is not None:
                part = parts.get(fragment)
                # Without births and deaths the ids are the same object.
                if part is None or piece.ids is not part.ids:
                    gained.append((fragment, _gained(part, piece.ids)))
            # The usual case, without a stack for each agent.
            elif isinstance(piece, AgentNode) and not piece.scope.pieces:
                single.append((piece.id, fragment))
            else:
                single += [(agent.id, fragment) for agent in agents(Scene((piece,)))]
    return single, gained


def _gained(part: Columns | None, ids: Ids) -> Ids:
    """The ids that a part did not have before; all of them if the fragment was a single agent."""
    if part is None:
        return ids
    row_delta = row_delta_of_ids(ids_of(part), ids)
    rows = np.flatnonzero(ids_of(part).rows_of(ids) < 0) if row_delta is None else row_delta.born
    return ids.take(rows)


def _is_from(event: AnyEvent, senders: Container[str], part: Columns | None) -> bool:
    if part is None or part.ids is None:
        return isinstance(event, Event) and event.sender in senders
    if isinstance(event, Event):
        return part.ids.row_of(event.sender) >= 0
    return event.senders is not None and bool((part.ids.rows_of(event.senders) >= 0).all())
