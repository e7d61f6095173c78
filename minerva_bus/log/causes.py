"""The chain of causes of a value in a record: methods, events and their senders.

The record has the events of each frame, and who sent them, but not the method that changed a
value. Therefore each frame of the chain is computed again, for one agent only, from the recorded
string and events.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from minerva_bus.frame.description import WorldSpec
from minerva_bus.frame.description import World
from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.events import AnyEvent, Event, first_of
from minerva_bus.grammar.printer import shown_value
from minerva_bus.grammar.scene import AgentNode, Value, agents
from minerva_bus.log.explanation import MAX_VALUE, Cause, EventSource, Explanation
from minerva_bus.log.past_frames import (
    PastFrame,
    ValueChange,
    agent_in,
    end_of,
    last_change,
    past_frames,
    piece_around,
    same_value,
    value_of,
)
from minerva_bus.log.record import Record
from minerva_bus.log.rejections import rejected_events, rejected_step
from minerva_bus.log.sources import same_event, source_of
from minerva_bus.source import SourceLine, assignments, defined, handler_name
from minerva_bus.wording import short
from minerva_bus.world.addressing import addressed
from minerva_bus.world.agent import Kinds
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import TracedCall, trace_calls
from minerva_bus.world.population import parents_of

MAX_LINKS: Final = 5
RECENT: Final = 10
"""Frames before the question in which rejections are looked for."""


def explain_value(
    record: Record, kinds: Kinds, name: str, attribute: str, frame: int | None = None
) -> Explanation:
    """How an agent's attribute got the value that it has when a frame begins.

    Args:
        record: a record of a run.
        kinds: the classes of the agents; of other kinds, the events are explained but no methods.
        name: id of the agent, without #.
        attribute: name of the attribute.
        frame: number of the frame; None: the end of the record.

    Raises:
        RecordError: the record has no such frame, agent or attribute.
        ActivityError: code of an agent fails.

    """
    end = end_of(record, frame)
    change = last_change(record, name, attribute, end)
    windows = ((change.frame - MAX_LINKS, change.frame + 1), (end - RECENT, end))
    past = {each.frame.number: each for window in windows for each in past_frames(record, *window)}
    causes = Causes(record.description.world, kinds, past)
    links, origin = causes.of_change(change, attribute)
    recent = range(end - 1, max(change.frame, end - RECENT - 1), -1)
    return Explanation(
        record.description.world.name,
        name,
        change.after.symbol,
        attribute,
        shown_value(value_of(change.after, attribute)),
        end,
        change.frame,
        tuple(links),
        origin,
        tuple(causes.rejected(name, recent)),
        record.initial.number,
    )


class Causes:
    """Causes in the frames `past` of a run, by number."""

    def __init__(self, world: WorldSpec, kinds: Kinds, past: Mapping[int, PastFrame]) -> None:
        self._world = world
        self._past = past
        # A copy processes other events than the agent, so only events are explained.
        self._kinds: Kinds = {} if world.policy.rules.makes_copies else kinds

    def of_change(self, change: ValueChange, attribute: str) -> tuple[list[Cause], str]:
        """The links from a change to its origin, and the origin in words."""
        if change.frame < 0 and change.gap:
            return [], "unknown: the value is older than the frames that are known"
        if change.frame < 0:
            return [], "the world file: the initial string has this value"
        new, name = value_of(change.after, attribute), change.after.id
        if change.before is not None:
            old = shown_value(value_of(change.before, attribute), MAX_VALUE)
            did = f"changed {attribute} from {old} to "
            actor = name
        else:
            did, actor = f"appeared with {attribute} = ", self._parent(name, change.frame)
        link = Cause(change.frame, name, did + shown_value(new, MAX_VALUE))
        if change.gap:
            return [link], "unknown: the frames before this one are lost"
        if not actor:
            return [link], "unknown: its id derives from no other agent"
        calls = self._calls(actor, change.frame)
        call = _last_setter(calls, change.before, name, attribute, new)
        remark = self._remark(change, attribute, call, calls)
        link, event = self._caused(replace(link, remark=remark), actor, call, attribute)
        return self._follow(link, event, remark)

    def rejected(self, name: str, frames: Sequence[int]) -> Iterator[str]:
        """What norms rejected in these frames, of an agent or for it."""
        refusing = [norm for norm in self._world.norms if norm.refuses]
        # Without one that judges steps, the agent's code need not run again.
        judged = any(not norm.on for norm in refusing)
        for then in [self._past[n] for n in frames if n in self._past] if refusing else ():
            yield from rejected_events(self._world, then, name)
            calls = self._calls(name, then.frame.number) if judged else ()
            step = self._rejected_step(name, then, calls)
            if step:
                yield step

    # --- links ---

    def _follow(self, link: Cause, event: Event | None, remark: str) -> tuple[list[Cause], str]:
        """The links from one to its origin, along the events that agents sent."""
        links = [link]
        while event is not None and (source := links[-1].source) is not None:
            if source.kind != "agent":
                return links, _origin(source, event)
            if len(links) == MAX_LINKS or source.frame not in self._past:
                return links, f"#{source.name} sent {event.type}; the chain is longer than this"
            sends = [
                call
                for call in self._calls(source.name, source.frame)
                if any(same_event(sent, event) for sent in call.emitted)
            ]
            sent = Cause(source.frame, source.name, f"sent {event.type}")
            link, event = self._caused(sent, source.name, sends[-1] if sends else None)
            links.append(link)
        return links, remark or "unknown: no event explains it"

    def _caused(
        self, link: Cause, actor: str, call: TracedCall | None, attribute: str = ""
    ) -> tuple[Cause, Event | None]:
        """A link with the method of `actor`, and the event that caused the call."""
        received = self.received(actor, link.frame)
        counts = Counter[str]()
        for each in received:
            counts[each.type] += len(each)
        link = replace(link, perceived=tuple(counts.items()))
        if call is None:
            # Without its code, an agent's only event must be the cause.
            event = first_of(received[0]) if sum(counts.values()) == 1 else None
        else:
            event = call.event
            name, place = handler_name(call.method), _place(call.method, attribute)
            link = replace(link, method=name, place=place)
        if event is None:
            return link, None
        source = source_of(event, self._past, link.frame, self._world.norms)
        return replace(link, event=event_text(event), source=source), event

    def _remark(
        self,
        change: ValueChange,
        attribute: str,
        call: TracedCall | None,
        calls: Sequence[TracedCall],
    ) -> str:
        """What the reader must know about a change in addition to its method."""
        name, new = change.after.id, value_of(change.after, attribute)
        computed = call is not None and _is_value(call, name, attribute, new)
        if computed and call is not None and call.caller.id != name:
            relation = "contains it" if change.before is not None else "is its parent"
            return f"the method is that of #{call.caller.id}, which {relation}"
        if computed:
            return ""
        step = self._rejected_step(name, self._past[change.frame], calls)
        if step:
            return step
        if call is not None:
            return "the code computes another value now: it has changed since the run"
        if self._world.policy.rules.makes_copies:
            return f'methods are not traced under the policy "{self._world.policy.value}"'
        if not self._kinds:
            return "no code was run, so the method is unknown"
        known = change.after.symbol in self._kinds
        return "" if known else f"the code of {change.after.symbol} is not Python here"

    # --- one agent in one frame ---

    def _calls(self, name: str, number: int) -> list[TracedCall]:
        if not self._kinds:
            return []
        then = self._past[number]
        frame = Frame(number, self._world.dt, self._world.seed)
        around = piece_around(then.before, name)
        (events,) = self._world.policy.rules.divide(addressed(then.frame.events))
        return trace_calls(around, name, events, self._kinds, frame)

    def received(self, name: str, number: int) -> list[AnyEvent]:
        """The events that an agent received in a frame, in order, by their receivers and types."""
        then = self._past[number]
        agent = agent_in(then.before, name)
        kind = None if agent is None else self._world.vocabulary.kinds.get(agent.symbol)
        types = kind.subscribes if kind is not None else frozenset[str]()
        return [event for _, event in addressed(then.frame.events).to(name, types)]

    def _rejected_step(self, name: str, then: PastFrame, calls: Sequence[TracedCall]) -> str:
        return rejected_step(self._world, then, name, calls[-1].string) if calls else ""

    def _parent(self, name: str, number: int) -> str:
        """The agent of whose id that of a newborn is derived; empty if there is none."""
        births = {
            agent.id: count if isinstance(count := agent.state.get("births", 0), int) else 0
            for agent in agents(self._past[number].before)
        }
        return parents_of([name], births).get(name, "")


def _last_setter(
    calls: Sequence[TracedCall], before: AgentNode | None, name: str, attribute: str, new: Value
) -> TracedCall | None:
    """The last call that gave an attribute its value, or else the last one that changed it."""
    setters: list[TracedCall] = []
    for call in calls:
        after = call.agent(name)
        if after is not None and not same_value(before, after, attribute):
            setters.append(call)
        before = after
    exact = [call for call in setters if _is_value(call, name, attribute, new)]
    return next(iter((*exact[-1:], *setters[-1:])), None)


def _is_value(call: TracedCall, name: str, attribute: str, value: Value) -> bool:
    agent = call.agent(name)
    return agent is not None and same_values((value_of(agent, attribute),), (value,))


def _place(method: Callable[..., Any], attribute: str) -> SourceLine | None:
    """The only line of a method that sets the attribute, else its first line."""
    lines = assignments(method, attribute) if attribute else []
    return lines[0] if len(lines) == 1 else defined(method)


def event_text(event: Event) -> str:
    """An event without its sender and receivers, which an explanation names elsewhere."""
    return str(replace(event, sender="", receivers=()))


def _origin(source: EventSource, event: Event) -> str:
    """The end of a chain in words."""
    if source.kind == "norm":
        return f"{source.text} punishes a violation in frame {source.frame} by {event.type}"
    person = f"the person {source.person}" if source.person else "a person"
    order = f", for the order {short(source.order)} of {person}" if source.order else ""
    return f"{source.text} sent {event.type} for frame {source.frame}{order}"
