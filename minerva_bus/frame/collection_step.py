"""Steps 2 to 4 of Table 2: requests to generators, and the events of a frame.

`FrameInbox` has the events that wait for the next frame, `SenderRights` the agents in whose name a
generator may send events, `OrderRules` the events that people and guests may send. Their order,
E(C*, t) of equation 6, is `collect` in world/event_order.py.

`EventWork` weighs events by the work that they cause at hosts. A message that costs its sender and
the coordinator little may cost the hosts much: an event without receivers goes to every agent of
the world, and each evaluates its condition. So an event counts as several of the limited single
events if hosts have much work with it. Section 14 of PROTOCOL.md has the rules. A weight depends on
the event and the string alone, not on the time that a host needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import islice
from operator import attrgetter
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import nearest
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.composition import Composition, ids_of
from minerva_bus.frame.member_table import MemberEntry, Members
from minerva_bus.frame.norm_rejections import Norms
from minerva_bus.frame.stimuli import (
    AGENTS,
    DEVICES,
    DROPPED,
    Checkpoint,
    FrameInputs,
    Instructions,
    OrdersBySource,
    handed_over,
    is_dropped,
    is_handed_over,
    is_people,
    name_of,
    people_of,
    person_of,
    source_of,
)
from minerva_bus.frame.world_state import Phase, Progress, WorldSpec
from minerva_bus.grammar.columns import values_of
from minerva_bus.grammar.events import AnyEvent, Event, Events, chosen, first_of, senders_of
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene, Value
from minerva_bus.grammar.types import Of
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.world.event_order import by_receiver, collect
from minerva_bus.world.norms import SOURCE

MAX_SINGLE_EVENTS: Final = 2_000
"""Maximum events of one generator, outside columns, in a frame."""

MAX_HOST_EVENTS: Final = 8_000
"""Maximum events of one host, outside columns, in a frame."""

STEPS_PER_WEIGHT: Final = 250
"""Steps of hosts for which an event weighs 1 more; a step is an event for an agent."""

PART_STEPS: Final = 10
"""Steps of an event for a part of a population, which is evolved by columns."""

ROWS_PER_STEP: Final = 20
"""Agents in columns that take one step more."""

LETTERS_PER_STEP: Final = 8
"""Characters of a condition that take as long as the event itself: about one comparison."""

BYTES_PER_WEIGHT: Final = 32_768
"""Bytes of data for which an event weighs 1 more: a frame has all of its events in one message."""

SEARCHED: Final = 10_000
"""Events of a batch of a host up to which its receivers are searched for in the string."""

FEW: Final = 8
"""Events of a message up to which they are not weighed if none has a condition."""


class EventWork:
    """Weighs events by the agents that the string has now.

    `most_of_generator`, `most_of_host`: the limits of a member's events in a frame.
    """

    def __init__(self, composition: Composition, vocabulary: Vocabulary) -> None:
        self._composition = composition
        self._vocabulary = vocabulary
        self._responding = cache(self._kinds_of)
        self.most_of_generator: int = MAX_SINGLE_EVENTS
        self.most_of_host: int = MAX_HOST_EVENTS

    def allow(self, of_generator: int, of_host: int) -> None:
        """Set the limits of a world file."""
        self.most_of_generator, self.most_of_host = of_generator, of_host

    def objection(self, events: Sequence[AnyEvent], most: int, limit: str) -> str:
        """Reason why a member may not send these events in one message, or an empty string.

        `limit`: the name of the limit `most`.
        """
        weight = sum(map(self.weight, events))
        return self.over(weight, most, limit, events) if weight > most else ""

    def objection_to_host(self, events: Iterable[AnyEvent]) -> str:
        """As `objection`, for the events that the agents of a host send in a frame."""
        # A search for the receivers of a large population, in each frame, would cost more than all
        # else here, and its agents send to agents like them.
        weighed = [event for event in events if event.receivers is None or len(event) <= SEARCHED]
        return self.objection(weighed, self.most_of_host, "host_events")

    def over(self, weight: int, most: int, limit: str, events: Iterable[AnyEvent]) -> str:
        """Reason for refusing events of a weight over `most`."""
        return (
            f"events weigh {weight} by the work of hosts, over {most}:"
            f" {self.heaviest(events)}; name fewer receivers, shorten conditions and data, or raise"
            f" {limit} in [limits]"
        )

    def heaviest(self, events: Iterable[AnyEvent]) -> str:
        """The most expensive of some events, for a message."""
        event = max(events, key=self.steps)
        condition = f" with a condition of {len(event.condition)} characters"
        return (
            f"the heaviest is {event.type}, {self._deliveries(event)} times for an agent"
            f"{condition if event.condition else ''}"
        )

    def weight(self, event: AnyEvent) -> int:
        """The number of single events as which an event or a batch counts, at least 1."""
        return 1 + self.steps(event) // STEPS_PER_WEIGHT + _size(event) // BYTES_PER_WEIGHT

    def steps(self, event: AnyEvent) -> int:
        """The work of hosts with an event or a batch."""
        return self._deliveries(event) * (1 + len(event.condition) // LETTERS_PER_STEP)

    def _deliveries(self, event: AnyEvent) -> int:
        """The agents to which an event goes; fewer if they are in columns."""
        if not event.receivers:
            return len(event) * self._everyone(event.type)
        if isinstance(event, Event):
            return len(event.receivers)
        return self._of_batch(event.receivers)

    def _everyone(self, event_type: str) -> int:
        kinds, composition = self._responding(event_type), self._composition
        single = sum(count for kind, count in composition.single.items() if kind in kinds)
        parts = [part.count for part in composition.parts.values() if part.symbol in kinds]
        return single + sum(PART_STEPS + count // ROWS_PER_STEP for count in parts)

    def _kinds_of(self, event_type: str) -> frozenset[str]:
        kinds = self._vocabulary.kinds.items()
        return frozenset(name for name, kind in kinds if event_type in kind.subscribes | kind.views)

    def _of_batch(self, receivers: Ids) -> int:
        steps = len(receivers)
        for part in self._composition.parts.values():
            if part.ids is receivers:
                return PART_STEPS + steps // ROWS_PER_STEP
            rows = ids_of(part).rows_of(receivers)
            there = rows[rows >= 0]
            if len(there):
                # A population takes a batch in as many passes as one of its agents has events.
                steps += int(np.bincount(there).max()) * PART_STEPS + len(there) // ROWS_PER_STEP
                steps -= len(there)
        return steps


def _size(event: AnyEvent) -> int:
    """The approximate number of bytes of the data of an event or a batch."""
    if isinstance(event, Events):
        return sum(column.array.nbytes for column in event.columns)
    return sum(map(_length, event.values))


def _length(value: Value) -> int:
    if isinstance(value, str):
        return len(value)
    if isinstance(value, tuple):
        return sum(map(_length, value))
    return value.nbytes if isinstance(value, np.ndarray) else 8


def are_light(events: Sequence[AnyEvent]) -> bool:
    """Whether events are so few and simple that nothing is gained by weighing them."""
    return len(events) <= FEW and not any(e.condition or isinstance(e, Events) for e in events)


MAX_WAITING: Final = 100_000
"""Maximum events of one free-running generator in the queue, which grows while a world pauses."""


def counting(source: str, event: AnyEvent) -> str:
    """What an order of a person, or a batch of orders, does in a frame, for the log."""
    if isinstance(event, Event):
        return f"{event} of {person_of(source)} counts"
    return f"{event.count} {event.type} of {person_of(source)} count"


def report_dropped(
    out: Instructions, sources: Iterable[str], allowed: OrdersBySource, frame: int, host: str = ""
) -> None:
    """Report people's orders that no longer count in a frame, because it ended a host twice."""
    for source in filter(is_people, sources):
        for event in allowed.get(source, ()):
            ended = f"in frame {frame}, which ended {host or 'a host'} twice"
            out.log(ORDERS, f"{counting(source, event)} no more {ended}")
            if isinstance(event, Event):
                out.add(s.OrderJudged(event, name_of(source), frame, "dropped", host))


class FrameInbox:
    """Events that wait for the next frame, by source.

    `emitted`: events that agents have sent. `sanctions`: events from norms. `sent`: both, by
    source, as the last complete frame left them. `unknown` finds events for agents that have never
    been in the string; `work` weighs events when they arrive.
    """

    def __init__(self, past: Checkpoint, scene: Scene, work: EventWork) -> None:
        """`past` and `scene` are the state with which the world begins."""
        self.work = work
        self.events: dict[str, list[AnyEvent]] = {
            source: list(events) for source, events in past.inbox.items()
        }
        self.sanctions: list[AnyEvent] = self.events.pop(SOURCE, [])
        self.emitted: list[AnyEvent] = list(past.emitted)
        self.sent: Mapping[str, Sequence[AnyEvent]] = past.sent
        self.max_waiting: int = MAX_WAITING
        self.unknown = UnknownReceivers(scene)
        self._counts: dict[str, int] = {}

    def __bool__(self) -> bool:
        return bool(self.events or self.emitted or self.sanctions)

    def waiting(self) -> dict[str, tuple[AnyEvent, ...]]:
        """Events for the next frame by source, for a checkpoint."""
        waiting = {source: tuple(events) for source, events in self.events.items()}
        return {**waiting, SOURCE: tuple(self.sanctions)} if self.sanctions else waiting

    def end_frame(self, emitted: list[AnyEvent]) -> None:
        """Queue the events that agents sent in a frame that is complete."""
        self.emitted = emitted
        # A copy, because the next frame takes the sanctions before it is complete.
        self.sent = {AGENTS: emitted, SOURCE: tuple(self.sanctions)}

    def take_sanctions(self) -> list[AnyEvent]:
        """Remove and return the sanctions, sorted by receivers; those of one keep their order."""
        taken, self.sanctions = self.sanctions, []
        return by_receiver(taken)

    def replace(self, events: Mapping[str, Sequence[AnyEvent]]) -> None:
        """Replace all waiting events by these."""
        self.events = {source: list(waiting) for source, waiting in events.items()}

    def add(self, source: str, events: Sequence[AnyEvent]) -> bool:
        """Add events of a generator, which count by their weight; False if its queue is full."""
        waiting = self.events.setdefault(source, [])
        # A running count, because adding up the queue for each message would take quadratic time.
        held = self._counts.get(source)
        if held is None:  # The first since the last frame, or since the world was resumed.
            held = sum(map(len, waiting))
        # Whole messages are accepted or dropped, so the limit may be exceeded by one message.
        if held >= self.max_waiting:
            return False
        count = max(sum(map(len, events)), sum(map(self.work.weight, events)))
        self._counts[source] = held + count
        waiting.extend(events)
        return True

    def add_order(self, event: AnyEvent, person: str) -> None:
        """Add an event, or a batch, from a person, which counts by its weight."""
        source = source_of(person)
        self.events.setdefault(source, []).append(event)
        self._counts[source] = self.ordered_by(person) + self.work.weight(event)

    def too_much_work(self, event: AnyEvent, person: str) -> str:
        """Reason for rejecting an order that gives hosts too much work, or an empty string."""
        weight = self.ordered_by(person) + self.work.weight(event)
        most = self.work.most_of_generator
        return self.work.over(weight, most, "single_events", (event,)) if weight > most else ""

    def ordered_by(self, person: str) -> int:
        """The count of the orders of a person since the last frame."""
        return self._counts.get(source_of(person), 0)

    def take_orders(self, is_taken: Callable[[str], bool]) -> OrdersBySource:
        """Remove the orders whose event type a generator takes, and return them by source."""
        taken: dict[str, tuple[AnyEvent, ...]] = {}
        for source in sorted(filter(is_people, self.events)):
            orders = tuple([event for event in self.events[source] if is_taken(event.type)])
            if orders:
                taken[source] = orders
                left = [event for event in self.events.pop(source) if not is_taken(event.type)]
                self.events |= {source: left} if left else {}
        return taken

    def take(self, is_taken: Callable[[str], bool]) -> dict[str, list[AnyEvent]]:
        """Remove and return the events for this frame.

        Orders that a generator takes stay: they arrived after the request to it.
        """
        # The counts start again with the queues; held-back events are counted by the next `add`.
        taken, self.events, self._counts = self.events, {}, {}
        for source in sorted(filter(is_people, taken)):
            late = [event for event in taken[source] if is_taken(event.type)]
            if late:
                self.events[source] = late
                in_time = [event for event in taken.pop(source) if not is_taken(event.type)]
                taken |= {source: in_time} if in_time else {}
        return taken

    def hold_back(self) -> dict[str, list[AnyEvent]]:
        """Remove the events, by source, that exceed the limit of one frame."""
        later: dict[str, list[AnyEvent]] = {}
        work, most = self.work, self.work.most_of_generator
        for source, events in self.events.items():
            if is_people(source) or (len(events) <= most and are_light(events)):
                continue
            count = 0
            for taken, event in enumerate(events):
                count += work.weight(event)
                # The first one always counts: the string may have grown since it arrived.
                if count > most and taken:
                    later[source] = events[taken:]
                    self.events[source] = events[:taken]
                    break
        return later

    def put_back(self, later: Mapping[str, Sequence[AnyEvent]]) -> None:
        """Queue events that were held back, before those that arrived since."""
        for source, events in later.items():
            self.events[source] = [*events, *self.events.get(source, ())]


EVENTS: Final = "events"
"""The name under which they are logged."""

MAX_NAMES: Final = 10_000
"""Agents up to which an error compares their ids with an unknown one."""

MAX_RECEIVERS: Final = 1_000
"""Receivers of a batch that are compared with the string."""


def unknown_agent(composition: Composition, receiver: str, otherwise: str = "") -> str:
    """`#receiver`, shortened, with a hint; `otherwise` is one if no agent has a similar id."""
    known = sorted(islice(composition.agents(), MAX_NAMES))
    return f"#{receiver[:64]}{nearest(receiver, known, otherwise)}"


class UnknownReceivers:
    """The receivers of events that neither the string nor the first string `w` has.

    Agents die, and others cannot know it at once, so events for them are no mistake. The ids of
    newborns begin with those of their ancestors.
    """

    def __init__(self, w: Scene) -> None:
        self._w = w
        self._reported = set[str]()

    @cached_property
    def _first(self) -> Composition:
        return Composition(self._w)

    def problems(self, events: Iterable[AnyEvent], composition: Composition) -> Iterator[str]:
        """A line for each event type with such a receiver, once for each type."""
        single = dict[str, AnyEvent]()
        for event in events:
            if not event.receivers or event.type in self._reported:
                continue
            if isinstance(event, Events):
                first = event.receivers
                if len(first) > MAX_RECEIVERS:
                    first = first.take(slice(MAX_RECEIVERS))
                receiver = composition.first_missing(first)
                if receiver is not None:
                    single.setdefault(receiver, event)
            else:
                for receiver in event.receivers[:MAX_RECEIVERS]:
                    single.setdefault(receiver, event)
        known = composition.home_of_each(single) if single else {}
        for receiver in sorted(single.keys() - known.keys()):
            event = single[receiver]
            if event.type not in self._reported and not self._was_there(receiver):
                self._reported.add(event.type)
                sender = first_of(event).sender
                by = f" of #{sender}" if sender else ""
                whom = unknown_agent(composition, receiver)
                yield f"{event.type}{by} goes to an agent that the string does not have: {whom}"

    def _was_there(self, receiver: str) -> bool:
        parts = receiver.split(":")
        ancestors = [":".join(parts[:count]) for count in range(1, len(parts) + 1)]
        return bool(self._first.home_of_each(ancestors))


ID: Final = "#"
"""Prefix of an entry of `speaks_for` that is the id of an agent, not a kind."""


@dataclass(frozen=True, slots=True)
class SenderRights:
    """The senders that generators may use.

    `speaks_for`: by member, the kinds of agents and the `#id`s of agents in whose name it may send
    events. Any other member only sends events without a sender.
    """

    speaks_for: Mapping[str, tuple[str, ...]]
    composition: Composition

    def objection(self, member: str, events: Sequence[AnyEvent]) -> str:
        """Reason why a member may not send these events, or an empty string.

        Events from agents that are no longer in the string do not count as a violation of a member
        with such rights, because an agent may just have died: `kept` drops these events.
        """
        allowed = self.speaks_for.get(member, ())
        for event in events:
            senders = senders_of(event)
            if senders is None:
                continue
            wrong = ~self._may(senders, allowed)
            if allowed:
                # Only existing agents that the member may not represent are a violation.
                wrong &= self.composition.kinds(senders) != ""
            if wrong.any():
                sender = senders[int(np.argmax(wrong))]
                whom = f"only for {', '.join(allowed)}" if allowed else "only for itself"
                return (
                    f"it sent {event.type} from #{sender[:64]}, but it speaks {whom};"
                    f" speaks_for under [process.{member}] names others"
                )
        return ""

    def kept(self, member: str, events: Sequence[AnyEvent]) -> list[AnyEvent]:
        """The events without sender, or whose sender is an agent that the member may represent."""
        allowed, kept = self.speaks_for.get(member, ()), list[AnyEvent]()
        for event in events:
            senders = senders_of(event)
            rows = None if senders is None else self._may(senders, allowed)
            if rows is None or rows.all():
                kept.append(event)
            else:
                kept += chosen(event, np.flatnonzero(rows))
        return kept

    def _may(self, senders: Ids, allowed: Sequence[str]) -> NDArray[np.bool_]:
        kinds = self.composition.kinds(senders)
        # A sender outside of the string has an empty kind, which no entry names.
        may = np.isin(kinds, [name for name in allowed if not name.startswith(ID)])
        ids = [name.removeprefix(ID) for name in allowed if name.startswith(ID)]
        if ids:
            may |= (Ids.of(ids).rows_of(senders) >= 0) & (kinds != "")
        return may


ORDERS: Final = "orders"
"""Name under which orders are logged."""

_TYPE: Final = attrgetter("type")
_NOBODY: Final = frozenset[str]()  # Half a microsecond, which an empty frame would notice.


MAX_LISTED: Final = 12


class OrderRules:
    """Which events people and guests may send, by the members and the string that a world has."""

    def __init__(
        self,
        world: WorldSpec,
        now: Progress,
        members: Members,
        composition: Composition,
    ) -> None:
        self._world = world
        self._now = now
        self._members = members
        self._composition = composition

    def refusal_of_order(self, event_type: str) -> str:
        """Reason for rejecting people's events of a type, or an empty string.

        They may send event types that a generator takes as orders, that the world file lists, or
        that neither a generator makes nor a norm sends. All other events are measured or computed;
        sent from a terminal they would be false statements about the world.
        """
        reserved, members = self._reservation(event_type), self._members
        if reserved:
            return f'{reserved}, or give it a process with service = "orders"'
        # A generator that joins later may make events of this type by itself.
        if self._now.phase is not Phase.WAITING:
            return ""
        unknown = [member.name for member in members if member.expected and member.hello is None]
        allowed = event_type in self._world.people or members.takers(event_type)
        if unknown and not allowed:
            return (
                f"whether people may send {event_type} depends on members that have not joined yet:"
                f" {', '.join(unknown[:5])}; send it when the world runs"
            )
        return ""

    def refusal_of_guest(self, hello: m.Hello, event_types: Iterable[str]) -> str:
        """Reason for rejecting these event types of an attached generator, or an empty string.

        One that stands for people, such as a keyboard, may send what people may send; another may
        be a sensor, but no norm. What a process of the world file sends is the choice of this file.
        """
        reserves = self._reservation if hello.people else self._reservation_by_norms
        reasons = (reserves(event_type) for event_type in dict.fromkeys(event_types))
        reserved = next(filter(None, reasons), "")
        return reserved and f"{reserved}, or make {hello.member} a process of it"

    def _reservation(self, event_type: str) -> str:
        """Why an event type is not for people, and how to allow it; or an empty string."""
        members = self._members
        # An attached generator that takes orders cannot allow what the world file does not.
        if event_type in self._world.people or any(
            map(members.is_process, members.takers(event_type))
        ):
            return ""
        makers = ", ".join(members.makers(event_type))
        return self._reservation_by_norms(event_type) or (makers and _reserved(event_type, makers))

    def _reservation_by_norms(self, event_type: str) -> str:
        """Why an event type is for norms alone, and how to allow it; or an empty string."""
        if event_type in self._world.people:
            return ""
        norms = [norm for norm in self._world.norms if event_type in norm.sends]
        names = ", ".join(norm.name for norm in norms[:MAX_LISTED])
        return names and _reserved(event_type, f"the norm{'s'[: len(norms) > 1]} {names}")

    def without_effect(self, event: Event) -> str:
        """Why an order can change nothing, or an empty string: no receiver responds to it."""
        vocabulary = self._world.vocabulary
        if vocabulary.events[event.type].visual or self._members.takers(event.type):
            return ""
        kinds = {self._composition.kind(receiver) for receiver in event.receivers} - {""}
        responding = [
            name for name, kind in vocabulary.kinds.items() if event.type in kind.subscribes
        ]
        if not (kinds or {*vocabulary.kinds}).isdisjoint(responding):
            return ""
        if not responding:
            return f"no agent kind of this world responds to {event.type}"
        return (
            f"no {' or '.join(sorted(kinds))} responds to {event.type}; {listed(responding)} does"
        )

    def unknown_value(self, event: Event, known_by: dict[Of, set[str]] | None = None) -> str:
        """Reason for rejecting an order with a value that the world lacks, or an empty string.

        `known_by` keeps the values of the string for further events at the same time.

        It compares the order with the values that the string has for the event's type. A string
        without such a value is no reason to reject it, because objects that a robot detects are not
        in it.
        """
        for field in self._world.vocabulary.events[event.type].fields.all:
            source = field.type.source
            if source is None:
                continue
            known_by = {} if known_by is None else known_by
            known = known_by.get(source)
            if known is None:
                known = known_by[source] = set(map(str, values_of(self._composition.scene, source)))
            value: object = event.data[field.name]
            texts = cast("tuple[str, ...]", value if isinstance(value, tuple) else (value,))
            for text in texts:
                # No agent could carry out an order with an unknown name, such as a misspelt
                # marker.
                if known and text not in known:
                    names = sorted(known)
                    return (
                        f"{event.type}: {field.name} is {text[:64]!r}, but no {source.symbol} of"
                        f" the world has this {source.parameter}; expected"
                        f" {listed(names)}{nearest(text, names)}"
                    )
        return ""


def _reserved(event_type: str, sources: str) -> str:
    return (
        f"{event_type} comes from {sources}, so people may not send it; to let them,"
        f' write people = ["{event_type}"] under [world] in the world file'
    )


def listed(names: Iterable[str]) -> str:
    """The first names of many, for a message."""
    shown = list(names)
    more = len(shown) - MAX_LISTED
    return ", ".join(shown[:MAX_LISTED]) + (f" or one of {more} more" if more > 0 else "")


class CollectionStep:
    """Collects the events of frames from generators, agents, people and norms."""

    def __init__(
        self,
        world: WorldSpec,
        now: Progress,
        members: Members,
        composition: Composition,
        inbox: FrameInbox,
        norms: Norms,
        orders: OrderRules,
        out: Instructions,
    ) -> None:
        self._world = world
        self._now = now
        self._members = members
        self._inbox = inbox
        self._norms = norms
        self._orders = orders
        self._out = out
        self._speaking = SenderRights(world.speaks_for, composition)

    # --- requests ---

    def begin(self) -> None:
        """Request the events of a frame's generators, and send them people's orders."""
        index = self._members.index
        in_flight = self._now.in_flight
        # Orders precede the tick, because a generator derives events of this frame from them.
        if in_flight.logged is not None:
            self._load(in_flight.logged)
        elif self._inbox.events:
            self._hand_over(self._inbox.take_orders(self._has_taker))
        # `tickers` includes members that are away and awaited: the frame waits for their return.
        resting = self._resting() if index.alone else _NOBODY
        in_flight.pending = set(index.tickers - in_flight.ticked.keys() - resting)
        if index.anyone_ticks:
            self._out.add(s.Send(s.TICKED, m.TickRequest(self._now.frame)))
        for entry in index.alone:
            if entry.active and entry.name in in_flight.pending:
                self._out.send(entry.name, m.TickRequest(self._now.frame))

    def _resting(self) -> frozenset[str]:
        """The generators without events in this frame: they get no orders, or are not due."""
        members = self._members
        resting = members.resting
        if resting and self._now.in_flight.events.permitted:
            entries = map(members.get, resting)
            resting = frozenset(entry.name for entry in entries if not self._orders_for(entry))
        frame, at_intervals = self._now.frame, members.index.at_intervals
        return resting.union(m.name for m, every in at_intervals if frame % every)

    def ask(self, member: MemberEntry) -> None:
        """Repeat the request to a generator that has returned while the frame waits for it."""
        self._give_orders(member)
        self._out.send(member.name, m.TickRequest(self._now.frame))

    def _hand_over(self, orders: OrdersBySource) -> None:
        """Apply norms to the orders that generators take, and send the permitted ones.

        Orders are people's events; the events that a generator derives from them are its own.
        """
        events = self._now.in_flight.events
        events.orders = orders
        if orders:
            events.permitted = self._permitted_orders(orders)
            for member in self._members.active():
                self._give_orders(member)

    def _load(self, inputs: FrameInputs) -> None:
        """Queue the logged events of a frame, and send the logged orders."""
        in_flight = self._now.in_flight
        self._inbox.replace(inputs.taken)
        in_flight.ticked |= inputs.ticked
        in_flight.events.people = inputs.people
        inbox = self._inbox.events
        handed = [source for source in sorted(inbox) if is_handed_over(source)]
        self._hand_over({people_of(source): inbox.pop(source) for source in handed})
        dropped = [source.removeprefix(DROPPED) for source in sorted(inbox) if is_dropped(source)]
        in_flight.events.dropped = tuple(dropped)
        # Norms have judged them before they were left out.
        inbox |= {source: inbox.pop(DROPPED + source) for source in dropped}

    def _has_taker(self, event_type: str) -> bool:
        return bool(self._members.takers(event_type))

    def _give_orders(self, member: MemberEntry) -> None:
        orders = self._orders_for(member)
        if orders:
            self._out.send(member.name, m.Orders(self._now.frame, orders))

    def _orders_for(self, member: MemberEntry) -> tuple[AnyEvent, ...]:
        """The orders of this frame that a member takes."""
        taken = member.hello.orders if member.hello is not None else ()
        permitted = self._now.in_flight.events.permitted
        return tuple([event for event in permitted if event.type in taken])

    # --- replies ---

    def tick_reply(self, reply: m.TickReply) -> str:
        """Accept C^d(t) of a member in step; returns the reason if it violates the protocol."""
        member = self._members.entries[reply.member]
        in_flight = self._now.in_flight
        in_time = reply.member in in_flight.pending and reply.frame == self._now.frame
        # A reply of a skipped or replaced process, or a second one, must not count. It is no
        # violation: the reply may have been sent before the member was skipped.
        if not (member.active and in_time):
            member.late += 1
            return ""
        # Most replies have no events and need no check.
        objection = self._objection(member, reply.events) if reply.events else ""
        if objection:
            return objection
        self._members.answered(member, self._now.frame)
        # One that had answered this frame to a previous coordinator takes further orders for it in
        # the next one.
        member.rests = member.rests or not self._orders_for(member)
        in_flight.pending.discard(reply.member)
        in_flight.ticked[reply.member] = reply
        return ""

    def emitted(self, emitted: m.Emitted) -> str:
        """Accept events of a free-running generator; returns the reason for a violation."""
        member = self._members.get(emitted.member)
        if not member.active:
            return ""
        objection = self._objection(member, emitted.events)
        if objection:
            return objection
        member.last_reply = self._now.frame
        if self._inbox.add(emitted.member, emitted.events):
            return ""
        # Logged once, because a sensor that is faster than the frames would fill the log.
        if not member.dropped:
            self._out.log(
                member.name,
                "event queue full: "
                f"{self._inbox.max_waiting} events wait for a frame; dropping further events",
            )
        member.dropped += sum(map(len, emitted.events))
        return ""

    def order(self, order: s.Publish) -> None:
        """Accept an event from a person for the next frame."""
        self._inbox.add_order(order.event, order.person)

    def _objection(self, member: MemberEntry, events: tuple[AnyEvent, ...]) -> str:
        """Reason why a member may not send these events, or an empty string."""
        declared = member.hello.generates if member.hello is not None else ()
        reason, light = "", len(events) <= FEW
        for event in events:
            # As `are_light`, without a call in each frame.
            light = light and not event.condition and event.__class__ is Event
            if event.type not in declared:
                events_declared = ", ".join(declared) or "no events"
                reason = f"it sent {event.type}, but its hello declares {events_declared}"
                break
        reason = reason or self._speaking.objection(member.name, events)
        # A frame that is computed again has been within the limits of its own run.
        if not (reason or light) and self._now.in_flight.logged is None:
            work = self._inbox.work
            reason = work.objection(events, work.most_of_generator, "single_events")
        if not reason and member.hello is not None and not self._members.is_process(member.name):
            # The process that makes these events may have joined after the guest.
            reason = self._orders.refusal_of_guest(member.hello, map(_TYPE, events))
        return reason

    # --- steps 2 to 4 ---

    def collect(self) -> None:
        """Steps 2 to 4: e*, e^v and e^u."""
        in_flight = self._now.in_flight
        index, due = self._members.index, ()
        if index.sources or index.rates:
            due = index.due_views(self._now.frame, in_flight.clock_views)
        later: Mapping[str, Sequence[AnyEvent]]
        if in_flight.logged is None:
            later = self._inbox.hold_back() if self._inbox.events else {}
        else:  # Logged events were few enough for one frame.
            later = in_flight.logged.waiting
            # The devices that requested these views may be absent now.
            due = tuple(sorted({*due, *in_flight.logged.due}))
        self._gather(due)
        if later:
            self._inbox.put_back(later)

    def _gather(self, due: tuple[str, ...]) -> None:
        events = self._now.in_flight.events
        taken, emitted = self._inbox.take(self._has_taker), self._inbox.emitted
        events.taken = {**taken}
        # The log needs the orders too: a recomputed frame hands them over again.
        for source, orders in events.orders.items():
            events.taken[handed_over(source)] = orders
        events.due = due
        # A copy, because the log needs `taken` as it was, before norms and rights remove events.
        sources: dict[str, Sequence[AnyEvent]] = {**taken}
        if emitted:
            sources[AGENTS] = emitted
        self._add_ticked(sources)
        if self._world.speaks_for:
            # The rights were checked on arrival, but the string may have changed since then.
            self._leave_out_foreign(sources)
        if self._world.shares:
            self._unite_shares(sources)
        if due:
            sources[DEVICES] = visual_events(self._world.vocabulary.events, due)
        if self._world.norms:
            logged = self._now.in_flight.logged
            events.people = self._members.standing_for_people(sources, logged)
        allowed = self._permitted(sources)
        if allowed:
            events.allowed = allowed
            ordered = collect(self._world.order, allowed)
            events.split(ordered, self._world.vocabulary.events)
        if events.dropped:
            report_dropped(self._out, events.dropped, allowed, self._now.frame)
            self._now.in_flight.leave_out(
                events.dropped, self._world.order, self._world.vocabulary.events
            )

    def _add_ticked(self, sources: dict[str, Sequence[AnyEvent]]) -> None:
        """Add the events of members in step, and keep their saved data."""
        saved = self._members.saved
        for member, reply in self._now.in_flight.ticked.items():
            if reply.events:
                sources[member] = [*reply.events, *sources.get(member, ())]
            if reply.saved is not None or member in saved:
                # A successor of a member that no longer saves data must not
                # continue from outdated ones.
                saved[member] = m.NOTHING_SAVED if reply.saved is None else reply.saved

    def _leave_out_foreign(self, sources: dict[str, Sequence[AnyEvent]]) -> None:
        """Drop events whose sender is not, or no longer, an agent that the source may represent."""
        for name in sorted(sources.keys() & self._world.speaks_for.keys()):
            kept = self._speaking.kept(name, sources[name])
            dropped = sum(map(len, sources[name])) - sum(map(len, kept))
            sources[name] = kept
            if dropped:
                member = self._members.get(name)
                if not member.dropped:
                    gone = "from agents that are not in the string"
                    self._out.log(name, f"sent {dropped} events {gone}; such events are left out")
                member.dropped += dropped

    def _unite_shares(self, sources: dict[str, Sequence[AnyEvent]]) -> None:
        """Make the events of processes that divide a generator those of one source.

        They are sorted by agent, so that their order does not depend on the number of processes.
        """
        made: dict[str, list[AnyEvent]] = {}
        for process in sorted(sources.keys() & self._world.shares.keys()):
            made.setdefault(self._world.shares[process], []).extend(sources.pop(process))
        sources |= {generator: by_receiver(events) for generator, events in made.items()}

    # --- norms on events ---

    def _permitted(self, sources: dict[str, Sequence[AnyEvent]]) -> dict[str, Sequence[AnyEvent]]:
        """The events that norms permit, and the sanctions that follow from the last frame."""
        # Taken out first, because the sanctions that `publish` adds below belong to the next frame.
        # They are not judged themselves: no norm can prevent the sanction of another.
        sanctions = self._inbox.take_sanctions() if self._inbox.sanctions else ()
        if self._world.norms:
            people = self._now.in_flight.events.people
            sources = dict(self._norms.events(self._now.frame, sources, people))
            self._inbox.sanctions += self._norms.publish(self._out, self._members.saved)
        if sources or self._world.norms:
            self._report_orders(sources)
        return {**sources, SOURCE: sanctions} if sanctions else sources

    def _permitted_orders(self, orders: OrdersBySource) -> tuple[AnyEvent, ...]:
        """People's orders that norms permit, before a generator takes them."""
        permitted = orders
        if self._world.norms:
            permitted = self._norms.events(self._now.frame, orders)
            self._inbox.sanctions += self._norms.publish(self._out, self._members.saved)
        self._report_orders(permitted)
        return tuple([event for source in sorted(permitted) for event in permitted[source]])

    def _report_orders(self, permitted: OrdersBySource) -> None:
        """Report the orders that norms reject, which norms log, and those that count."""
        frame, out = self._now.frame, self._out
        rejected = self._norms.take_rejected_orders() if self._world.norms else ()
        for source, event, norm in rejected:
            out.add(s.OrderJudged(event, name_of(source), frame, "rejected", norm))
        for source in sorted(filter(is_people, permitted)):
            for event in permitted[source]:
                if isinstance(event, Event):  # Programs send batches, and do not ask for fates.
                    out.log(ORDERS, f"{counting(source, event)} in frame {frame}")
                    out.add(s.OrderJudged(event, name_of(source), frame))


def visual_events(types: Mapping[str, EventType], due: Sequence[str]) -> tuple[Event, ...]:
    """The visual events that devices generate, without data or receivers."""
    return tuple([types[event_type]() for event_type in due])
