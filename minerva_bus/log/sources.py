"""The sources of a frame's events: agents, generators, people and norms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from minerva_bus.frame.inputs import (
    AGENTS,
    PEOPLE,
    is_handed_over,
    is_people,
    is_set_aside,
    name_of,
    person_of,
)
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import AnyEvent, Event, Events, single
from minerva_bus.log.explanation import EventSource
from minerva_bus.log.past_frames import PastFrame
from minerva_bus.world.norms import REFUSED, Norm


def sources_of(past: PastFrame) -> dict[str, list[AnyEvent]]:
    """What each source sent for a frame, before norms; empty for a record without inputs."""
    inputs, sent = past.frame.inputs, dict[str, list[AnyEvent]]()
    if inputs is not None:
        for member, reply in inputs.ticked.items():
            sent.setdefault(member, []).extend(reply.events)
        for source, events in inputs.taken.items():
            if not is_set_aside(source):
                sent.setdefault(source, []).extend(events)
    if past.checkpoint is not None and past.checkpoint.emitted:
        sent[AGENTS] = list(past.checkpoint.emitted)
    return sent


def source_of(
    event: Event, frames: Mapping[int, PastFrame], number: int, norms: Sequence[Norm]
) -> EventSource:
    """The source of an event of frame `number`; `frames` are the frames before it, too."""
    past = frames[number]
    sent = sources_of(past)
    for source in sorted(sent):
        if source == AGENTS or not _has(sent[source], event):
            continue
        if is_people(source):
            return person_behind(source, number)
        if source in past.people:
            return EventSource("person", source, number)
        order, person = _order_before(event, frames, number)
        return EventSource("generator", source, number, order, person)
    if event.sender:
        return EventSource("agent", event.sender, number - 1)
    sanctions = {norm.sanction.type for norm in norms if norm.sanction is not None}
    if event.type in sanctions or (norms and event.type == REFUSED):
        return EventSource("norm", str(event.data.get("norm", "")), number - 1)
    return EventSource("generator" if not sent else "unknown", "", number)


def person_behind(source: str, number: int) -> EventSource:
    """The person whose orders of frame `number` have this source; see `is_people`."""
    named = "" if source == PEOPLE else f"people:{person_of(source)}"
    return EventSource("person", named, number)


def _has(sent: Sequence[AnyEvent], event: Event) -> bool:
    """Whether an event, or one that contains its receiver, is among those of a source."""
    for each in sent:
        if each.type != event.type:
            continue
        own = each
        if isinstance(each, Events) and event.receivers and each.receivers is not None:
            own = each.to(event.receivers[0])
        if any(same_event(event, row) for row in own):
            return True
    return False


def same_event(a: Event, b: Event) -> bool:
    """Whether two events have the same type, data and receivers; senders may differ."""
    if a.type != b.type or not same_values(a.values, b.values):
        return False
    # A row of a batch names the receiver of that row alone.
    return set(a.receivers) == set(b.receivers) or bool(set(a.receivers) & set(b.receivers))


def _order_before(event: Event, frames: Mapping[int, PastFrame], number: int) -> tuple[str, str]:
    """The last order of this type and with these data that members were given, and who sent it."""
    for earlier in sorted((n for n in frames if n <= number), reverse=True):
        inputs = frames[earlier].frame.inputs
        if inputs is None:
            continue
        for source in sorted(filter(is_handed_over, inputs.taken)):
            for order in single(inputs.taken[source]):
                if order.type == event.type and same_values(order.values, event.values):
                    return f"{order} in frame {earlier}", name_of(source)
    return "", ""
