"""The chain of causes of a value in a record: methods, events and their senders.

The record has the events of each frame, and who sent them, but not the method that changed a
value. Therefore each frame of the chain is computed again, for one agent only, from the recorded
string and events. An explanation also has the sources of events (agents, generators, people and
norms) and what norms have rejected; an observation has an agent's state and what it received.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

from minerva_analysis.past_frames import (
    PastFrame,
    ValueChange,
    agent_at,
    agent_in,
    end_of,
    last_change,
    past_frames,
    piece_around,
    same_value,
    value_of,
)
from minerva_analysis.traced_calls import TracedCall, trace_calls
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.norm_rejections import Norms
from minerva_bus.frame.stimuli import (
    AGENTS,
    PEOPLE,
    is_handed_over,
    is_people,
    is_set_aside,
    name_of,
    person_of,
)
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.events import AnyEvent, Event, Events, first_of, single
from minerva_bus.grammar.scene import AgentNode, Scene, Value, agents
from minerva_bus.grammar.text_and_digest import same_values, shown_value
from minerva_bus.log.record import Record
from minerva_bus.user_code import SourceLine, assignments, defined, handler_name
from minerva_bus.wording import named_some, short
from minerva_bus.world.agent import Kinds
from minerva_bus.world.context import Frame
from minerva_bus.world.event_collection import addressed
from minerva_bus.world.norms import REFUSED, SOURCE, Norm
from minerva_bus.world.population import parents_of

MAX_LINKS: Final = 5
RECENT: Final = 10
"""Frames before the question in which rejections are looked for."""
MAX_PERCEIVED: Final = 6
MAX_REJECTED: Final = 5
MAX_VALUE: Final = 60
MAX_EARLIER: Final = 3


@dataclass(frozen=True, slots=True)
class EventSource:
    """The source of an event: its kind, its name and the frame in which it was sent.

    `kind` is "agent", "generator", "person", "norm" or "unknown". The name of a person is
    `people:NAME`, as in norms, or that of a generator that represents people. `order` is the order
    that a generator was given before, with its frame, and `person` the name of who sent it, if any.
    """

    kind: str
    name: str
    frame: int
    order: str = ""
    person: str = ""

    @property
    def text(self) -> str:
        """The source in words."""
        if self.kind == "agent":
            return f"#{self.name}"
        if self.kind == "person" and self.name.startswith("people:"):
            return f"the person {self.name.partition(':')[2]}"
        if self.kind == "person":
            return f"a person, through {self.name}" if self.name else "a person"
        if self.kind == "generator":
            return f"the generator {self.name}" if self.name else "a generator"
        return f"the norm {self.name}".rstrip() if self.kind == "norm" else "an unknown source"


@dataclass(frozen=True, slots=True)
class Cause:
    """One step of the chain: what an agent did in a frame, by which method, because of which event.

    `did` is the change or the event that is explained. `place` is the line of the method that did
    it, `agent` the agent whose method it is; both are empty if no code ran. `event` caused the
    call and has the `source`. `perceived` are all events that the agent received in the frame, by
    type, with their numbers.
    """

    frame: int
    agent: str
    did: str
    method: str = ""
    place: SourceLine | None = None
    event: str = ""
    source: EventSource | None = None
    perceived: tuple[tuple[str, int], ...] = ()
    remark: str = ""

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        return {
            "frame": self.frame,
            "agent": self.agent,
            "did": self.did,
            "method": self.method,
            "place": None if self.place is None else self.place.plain(),
            "event": self.event,
            "source": None if self.source is None else asdict(self.source),
            "perceived": dict(self.perceived),
            "remark": self.remark,
        }

    def lines(self) -> list[str]:
        """As lines of text."""
        shown = [f"frame {self.frame}: #{self.agent} {self.did}"]
        if self.place is not None:
            shown.append(f"  in {self.method}, {self.place.where}")
            shown += [f"      {text}" for text in self.place.shown[:1]]
        elif self.method:
            shown.append(f"  in {self.method}")
        if self.event:
            source = f", from {self.source.text}" if self.source is not None else ""
            shown.append(f"  because it received {short(self.event)}{source}")
        if self.perceived:
            counts = [f"{name} ×{count}" if count > 1 else name for name, count in self.perceived]
            shown.append(f"  all that it received: {named_some(counts, MAX_PERCEIVED)}")
        if self.remark:
            shown.append(f"  {self.remark}")
        return shown


@dataclass(frozen=True, slots=True)
class Explanation:
    """How an agent's attribute got its value.

    `value` is that at the beginning of `frame`; `since` is the frame in which it became so, -1 for
    the initial string. `links` lead from there back to `origin`. `rejected` are events and steps
    of the agent that norms have rejected in the last frames. `first` is the first frame that is
    known; -1 for `since` means that the value is older.
    """

    world: str
    agent: str
    kind: str
    attribute: str
    value: str
    frame: int
    since: int
    links: tuple[Cause, ...]
    origin: str
    rejected: tuple[str, ...] = ()
    first: int = 0

    @property
    def is_older(self) -> bool:
        """Whether the value is older than the frames that are known."""
        return self.since < 0 < self.first

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        own = {name: getattr(self, name) for name in self.__slots__}
        links = [link.plain() for link in self.links]
        return {**own, "links": links, "rejected": list(self.rejected)}

    def lines(self) -> list[str]:
        """As lines of text."""
        older = f"since before frame {self.first}" if self.first else "since the initial string"
        since = f"since frame {self.since}" if self.since >= 0 else older
        about = f"{self.kind}#{self.agent} {self.attribute} = {short(self.value, MAX_VALUE)}"
        shown = [f"{about} at the beginning of frame {self.frame}, {since}"]
        shown += [line for link in self.links for line in link.lines()]
        shown.append(f"origin: {self.origin}")
        shown += rejected_lines(self.rejected)
        return shown


def rejected_lines(rejected: Sequence[str]) -> list[str]:
    """Rejections as lines of text, the last ones first."""
    if not rejected:
        return []
    more = len(rejected) - MAX_REJECTED
    shown = [f"  {text}" for text in rejected[:MAX_REJECTED]]
    return ["recently rejected:", *shown, *([f"  and {more} more"] if more > 0 else [])]


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


def rejected_events(world: WorldSpec, past: PastFrame, name: str) -> Iterator[str]:
    """Events of a frame to or from an agent that norms have rejected, in words."""
    norms = [norm for norm in world.norms if norm.on and norm.refuses]
    types = {event_type for norm in norms for event_type in norm.on}
    kept = {each: _of_type(past, each) for each in types}
    composition: Composition | None = None
    for source, events in sorted(sources_of(past).items()):
        for event in single(each for each in events if each.type in types):
            concerned = name == event.sender or not event.receivers or name in event.receivers
            if not concerned or any(event == other for other in single(kept[event.type])):
                continue
            composition = composition or Composition(past.before)
            for norm in norms:
                judged = _norms(world, norm, composition, past).events(
                    past.frame.number, {source: [event]}, past.people
                )
                if not judged[source]:
                    whom = f"#{event.sender}" if event.sender else source
                    if is_people(source):
                        whom = person_behind(source, past.frame.number).text
                    yield f"{_begin(past, norm)} {short(str(event))}, sent by {whom}"
                    break


def rejected_step(world: WorldSpec, past: PastFrame, name: str, result: Scene) -> str:
    """The norm that rejected the result of λ for an agent, in words; empty if none did.

    `result` is what its methods made of the part of the string around it.
    """
    after = agent_in(past.after, name)
    computed = agent_in(result, name)
    if after is not None and computed is not None and after.values == computed.values:
        return ""
    # Each agent is a fragment of its own here, also one in columns.
    composition = Composition(past.before, columns=False)
    home = composition.home(name)
    for norm in [norm for norm in world.norms if not norm.on and norm.refuses]:
        judge = _norms(world, norm, composition, past)
        trial = judge.agents(past.frame.number, {home or name: result}, {})
        if trial is not None and trial.open:
            return f"{_begin(past, norm)} the step of #{name}"
    return ""


def _begin(past: PastFrame, norm: Norm) -> str:
    return f"frame {past.frame.number}: the norm {norm.name} rejected"


def _of_type(past: PastFrame, event_type: str) -> list[AnyEvent]:
    return [event for event in past.frame.events if event.type == event_type]


def _norms(world: WorldSpec, norm: Norm, composition: Composition, past: PastFrame) -> Norms:
    checkpoint = past.checkpoint
    counts: Mapping[str, Any] = {}
    if checkpoint is not None:
        counts = checkpoint.saved.get(SOURCE, counts)
    return Norms((norm,), composition, world.vocabulary, counts)


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
        calls = self.calls(actor, change.frame)
        setters = _setters(calls, change.before, name, attribute, new)
        call = setters[-1] if setters else None
        remark = self._remark(change, attribute, call, calls)
        shown = remark or _earlier(setters[:-1], name, attribute)
        link, event = self._caused(replace(link, remark=shown), actor, call, attribute)
        return self._follow(link, event, remark)

    def of_event(self, event: Event, number: int) -> tuple[list[Cause], str]:
        """The links from an event that an agent sent in a frame to its origin, and the origin."""
        link, caused_by = self._sent(event, event.sender, number)
        return self._follow(link, caused_by, "")

    def rejected(self, name: str, frames: Sequence[int]) -> Iterator[str]:
        """What norms rejected in these frames, of an agent or for it."""
        refusing = [norm for norm in self._world.norms if norm.refuses]
        # Without one that judges steps, the agent's code need not run again.
        judged = any(not norm.on for norm in refusing)
        for then in [self._past[n] for n in frames if n in self._past] if refusing else ():
            yield from rejected_events(self._world, then, name)
            calls = self.calls(name, then.frame.number) if judged else ()
            step = self._rejected_step(name, then, calls)
            if step:
                yield step

    # --- links ---

    def _follow(self, link: Cause, event: Event | None, remark: str) -> tuple[list[Cause], str]:
        """The links from one to its origin, along the events that agents sent."""
        links = [link]
        while event is not None and (source := links[-1].source) is not None:
            if source.kind != "agent":
                return links, origin_of(source, event)
            if len(links) == MAX_LINKS or source.frame not in self._past:
                return links, f"#{source.name} sent {event.type}; the chain is longer than this"
            link, event = self._sent(event, source.name, source.frame)
            links.append(link)
        return links, remark or "unknown: no event explains it"

    def _sent(self, event: Event, name: str, number: int) -> tuple[Cause, Event | None]:
        """The link of an event that an agent sent in a frame, and the event that caused it."""
        sends = [
            call
            for call in self.calls(name, number)
            if any(same_event(sent, event) for sent in call.emitted)
        ]
        link = Cause(number, name, f"sent {event.type}")
        return self._caused(link, name, sends[-1] if sends else None)

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

    def calls(self, name: str, number: int) -> list[TracedCall]:
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


def _setters(
    calls: Sequence[TracedCall], before: AgentNode | None, name: str, attribute: str, new: Value
) -> list[TracedCall]:
    """The calls that changed an attribute, up to the last one that gave it its value, if any."""
    setters: list[TracedCall] = []
    for call in calls:
        after = call.agent(name)
        if after is not None and not same_value(before, after, attribute):
            setters.append(call)
        before = after
    exact = [n for n, call in enumerate(setters) if _is_value(call, name, attribute, new)]
    return setters[: exact[-1] + 1] if exact else setters


def _earlier(setters: Sequence[TracedCall], name: str, attribute: str) -> str:
    """What other calls of the same frame had made of an attribute before the last one."""
    values: list[str] = []
    for call in setters:
        agent = call.agent(name)
        if agent is not None:
            value = shown_value(value_of(agent, attribute), MAX_VALUE)
            values.append(f"{value} by {handler_name(call.method)} ({call.event.type})")
    more = f" ({len(values) - MAX_EARLIER} more)" if len(values) > MAX_EARLIER else ""
    steps = ", then ".join(values[-MAX_EARLIER:])
    return f"earlier in this frame: {steps}{more}" if values else ""


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


def origin_of(source: EventSource, event: Event) -> str:
    """The end of a chain in words."""
    if source.kind == "norm":
        return f"{source.text} punishes a violation in frame {source.frame} by {event.type}"
    person = f"the person {source.person}" if source.person else "a person"
    order = f", for the order {short(source.order)} of {person}" if source.order else ""
    return f"{source.text} sent {event.type} for frame {source.frame}{order}"


MAX_RECEIVED: Final = 40
"""Entries about received events."""


@dataclass(frozen=True, slots=True)
class ReceivedEvents:
    """Events of one type that an agent received in a frame: the first one, and their number."""

    frame: int
    event: str
    count: int
    source: EventSource

    @property
    def text(self) -> str:
        """As a line of text."""
        more = f" and {self.count - 1} more" if self.count > 1 else ""
        return f"frame {self.frame}: {short(self.event)}{more}, from {self.source.text}"


@dataclass(frozen=True, slots=True)
class Observation:
    """An agent at the beginning of `frame`.

    `state` has the values of its attributes as text. `received` are the events of the last frames
    that were for the agent, newest frame first; an event with a condition may not have concerned
    it. `rejected` are events and steps of the agent that norms have rejected in these frames.
    """

    world: str
    agent: str
    kind: str
    frame: int
    state: tuple[tuple[str, str], ...]
    received: tuple[ReceivedEvents, ...]
    rejected: tuple[str, ...] = ()

    @property
    def is_older(self) -> bool:
        """False: what the frames before it lack is not part of the answer."""
        return False

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        own = {name: getattr(self, name) for name in self.__slots__}
        received = [asdict(each) for each in self.received]
        rejected = list(self.rejected)
        return {**own, "state": dict(self.state), "received": received, "rejected": rejected}

    def lines(self) -> list[str]:
        """As lines of text."""
        shown = [f"{self.kind}#{self.agent} at the beginning of frame {self.frame}"]
        shown += [f"  {name} = {short(value)}" for name, value in self.state]
        shown.append(f"received in the last {RECENT} frames:" if self.received else NOTHING)
        shown += [f"  {each.text}" for each in self.received]
        return [*shown, *rejected_lines(self.rejected)]


NOTHING: Final = f"it received nothing in the last {RECENT} frames"


def observe_agent(record: Record, kinds: Kinds, name: str, frame: int | None = None) -> Observation:
    """What an agent is when a frame begins, and what it received in the frames before.

    Args:
        record: a record of a run.
        kinds: the classes of the agents, which run again if a norm judges their steps.
        name: id of the agent, without #.
        frame: number of the frame; None: the end of the record.

    Raises:
        RecordError: the record has no such frame or agent.
        ActivityError: code of an agent fails.

    """
    end = end_of(record, frame)
    agent = agent_at(record, name, end)
    past = {each.frame.number: each for each in past_frames(record, end - RECENT, end)}
    causes = Causes(record.description.world, kinds, past)
    newest_first = sorted(past, reverse=True)

    def received() -> Iterator[ReceivedEvents]:
        for number in newest_first:
            counts: dict[str, int] = {}
            first: dict[str, Event] = {}
            for events in causes.received(name, number):
                counts[events.type] = counts.get(events.type, 0) + len(events)
                first.setdefault(events.type, first_of(events))
            for event_type, event in first.items():
                source = source_of(event, past, number, record.description.world.norms)
                text = event_text(event)
                yield ReceivedEvents(number, text, counts[event_type], source)

    return Observation(
        record.description.world.name,
        name,
        agent.symbol,
        end,
        tuple([(attribute, shown_value(agent.state[attribute])) for attribute in agent.names]),
        tuple(each for each, _ in zip(received(), range(MAX_RECEIVED), strict=False)),
        tuple(causes.rejected(name, newest_first)),
    )
