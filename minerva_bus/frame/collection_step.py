"""Steps 2 to 4 of Table 2: requests to generators, and the events of a frame.

`CollectionStep` asks generators and gathers what they and others have sent; `FrameInbox` has the
events that wait for the next frame. Who may send what is in sender_rights.py; the order of events,
E(C*, t) of equation 6, is `collect` in world/event_collection.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.composition import Composition
from minerva_bus.frame.member_table import MemberEntry, Members
from minerva_bus.frame.norm_rejections import Norms
from minerva_bus.frame.sender_rights import (
    FEW,
    EventWork,
    OrderRules,
    SenderRights,
    UnknownReceivers,
    are_light,
)
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
from minerva_bus.frame.world_state import Progress, WorldSpec
from minerva_bus.grammar.events import AnyEvent, Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.event_collection import by_receiver, collect
from minerva_bus.world.norms import SOURCE

ORDERS: Final = "orders"
"""Name under which orders are logged."""

_TYPE: Final = attrgetter("type")
_NOBODY: Final = frozenset[str]()  # Half a microsecond, which an empty frame would notice.


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
            self._hand_over(self._inbox.take_orders(self._members.takers))
        # `tickers` includes members that are away and awaited: the frame waits for their return.
        resting = self._resting() if index.alone else _NOBODY
        in_flight.pending = set(index.tickers - in_flight.ticked.keys() - resting)
        if index.anyone_ticks:
            self._out.pending.append(s.Send(s.TICKED, m.TickRequest(self._now.frame)))
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
            for member in self._members.index.active:
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
        taken, emitted = self._inbox.take(self._members.takers), self._inbox.emitted
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
            out.pending.append(s.OrderJudged(event, name_of(source), frame, "rejected", norm))
        for source in sorted(filter(is_people, permitted)):
            for event in permitted[source]:
                if isinstance(event, Event):  # Programs send batches, and do not ask for fates.
                    out.log(ORDERS, f"{counting(source, event)} in frame {frame}")
                    out.pending.append(s.OrderJudged(event, name_of(source), frame))


def visual_events(types: Mapping[str, EventType], due: Sequence[str]) -> tuple[Event, ...]:
    """The visual events that devices generate, without data or receivers."""
    return tuple([types[event_type]() for event_type in due])


MAX_WAITING: Final = 100_000
"""Maximum events of one free-running generator in the queue, which grows while a world pauses."""


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

    def take_orders(self, is_taken: Callable[[str], object]) -> OrdersBySource:
        """Remove the orders whose event type a generator takes, and return them by source."""
        taken: dict[str, tuple[AnyEvent, ...]] = {}
        for source in sorted(filter(is_people, self.events)):
            orders = tuple([event for event in self.events[source] if is_taken(event.type)])
            if orders:
                taken[source] = orders
                left = [event for event in self.events.pop(source) if not is_taken(event.type)]
                self.events |= {source: left} if left else {}
        return taken

    def take(self, is_taken: Callable[[str], object]) -> dict[str, list[AnyEvent]]:
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
                out.pending.append(s.OrderJudged(event, name_of(source), frame, "dropped", host))
