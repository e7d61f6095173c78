"""Steps 1 to 4 of Table 2: requests to generators, and the events of a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.calling import NOTHING
from minerva_bus.frame.event_sources import (
    AGENTS,
    DEVICES,
    DROPPED,
    handed_over,
    is_dropped,
    is_handed_over,
    is_people,
    name_of,
    people_of,
)
from minerva_bus.frame.inbox import OrdersBySource, counting
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.member_states import MemberChange, MemberEntry, MemberState
from minerva_bus.frame.orders import refusal_of_guest
from minerva_bus.frame.senders import SenderRights
from minerva_bus.frame.views import due_views
from minerva_bus.frame.work import FEW
from minerva_bus.grammar.events import AnyEvent, Event
from minerva_bus.world.norms import SOURCE
from minerva_bus.world.order import collect

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm

ORDERS: Final = "orders"
"""Name under which orders are logged."""

_TYPE: Final = attrgetter("type")


class CollectionStep:
    """Collects the events of frames from generators, agents, people and norms."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm
        self._speaking = SenderRights(algorithm.world.speaks_for, algorithm.composition)

    # --- requests ---

    def begin(self) -> None:
        """Request the events of a frame's generators, and send them people's orders."""
        algorithm, index = self._algorithm, self._algorithm.members.index
        in_flight = algorithm.in_flight
        # Orders precede the tick, because a generator derives events of this frame from them.
        if in_flight.logged is None:
            self._hand_over(algorithm.inbox.take_orders(self._has_taker))
        else:
            self._load(in_flight.logged)
        # `tickers` includes members that are away and awaited: the frame waits for their return.
        resting = self._resting()
        in_flight.pending = set(index.tickers - in_flight.ticked.keys() - resting)
        if index.anyone_ticks:
            algorithm.out.send(s.TICKED, m.TickRequest(algorithm.frame))
        for entry in (*index.on_orders, *[entry for entry, _ in index.at_intervals]):
            if entry.active and entry.name in in_flight.pending:
                algorithm.out.send(entry.name, m.TickRequest(algorithm.frame))

    def _resting(self) -> frozenset[str]:
        """The generators without events in this frame: they get no orders, or are not due."""
        algorithm, members = self._algorithm, self._algorithm.members
        resting = members.resting
        if resting and algorithm.in_flight.events.permitted:
            entries = map(members.get, resting)
            resting = frozenset(entry.name for entry in entries if not self._orders_for(entry))
        at_intervals = members.index.at_intervals
        if not at_intervals:
            return resting
        frame = algorithm.frame
        return resting.union(m.name for m, every in at_intervals if m.active and frame % every)

    def ask(self, member: MemberEntry) -> None:
        """Repeat the request to a generator that has returned while the frame waits for it."""
        self._give_orders(member)
        self._algorithm.out.send(member.name, m.TickRequest(self._algorithm.frame))

    def _hand_over(self, orders: OrdersBySource) -> None:
        """Apply norms to the orders that generators take, and send the permitted ones.

        Orders are people's events; the events that a generator derives from them are its own.
        """
        algorithm, events = self._algorithm, self._algorithm.in_flight.events
        events.orders = orders
        if orders:
            events.permitted = self._permitted_orders(orders)
            for member in algorithm.members.active():
                self._give_orders(member)

    def _load(self, inputs: FrameInputs) -> None:
        """Queue the logged events of a frame, and send the logged orders."""
        algorithm, in_flight = self._algorithm, self._algorithm.in_flight
        algorithm.inbox.replace(inputs.taken)
        in_flight.ticked |= inputs.ticked
        in_flight.events.people = inputs.people
        inbox = algorithm.inbox.events
        handed = [source for source in sorted(inbox) if is_handed_over(source)]
        self._hand_over({people_of(source): inbox.pop(source) for source in handed})
        dropped = [source.removeprefix(DROPPED) for source in sorted(inbox) if is_dropped(source)]
        in_flight.events.dropped = tuple(dropped)
        # Norms have judged them before they were left out.
        inbox |= {source: inbox.pop(DROPPED + source) for source in dropped}

    def _has_taker(self, event_type: str) -> bool:
        return bool(self._algorithm.members.takers(event_type))

    def _give_orders(self, member: MemberEntry) -> None:
        algorithm = self._algorithm
        orders = self._orders_for(member)
        if orders:
            algorithm.out.send(member.name, m.Orders(algorithm.frame, orders))

    def _orders_for(self, member: MemberEntry) -> tuple[AnyEvent, ...]:
        """The orders of this frame that a member takes."""
        taken = member.hello.orders if member.hello is not None else ()
        permitted = self._algorithm.in_flight.events.permitted
        return tuple([event for event in permitted if event.type in taken])

    # --- replies ---

    def tick_reply(self, reply: m.TickReply) -> None:
        """Accept C^d(t) of a member in step."""
        algorithm = self._algorithm
        member = algorithm.members.get(reply.member)
        in_time = algorithm.awaits_tick(reply.member) and reply.frame == algorithm.frame
        # A reply of a skipped or replaced process, or a second one, must not count. It is no
        # violation: the reply may have been sent before the member was skipped.
        if not (member.active and in_time):
            member.late += 1
            return
        # Most replies have no events and need no check.
        if reply.events and not self._may_generate(member, reply.events):
            return
        note_answer(algorithm, member)
        # One that had answered this frame to a previous coordinator takes further orders for it in
        # the next one.
        member.rests = member.rests or not self._orders_for(member)
        algorithm.in_flight.pending.discard(reply.member)
        algorithm.in_flight.ticked[reply.member] = reply

    def emitted(self, emitted: m.Emitted) -> None:
        """Accept events of a free-running generator for the next frame."""
        algorithm = self._algorithm
        member = algorithm.members.get(emitted.member)
        if not member.active or not self._may_generate(member, emitted.events):
            return
        member.last_reply = algorithm.frame
        if algorithm.inbox.add(emitted.member, emitted.events):
            return
        # Logged once, because a sensor that is faster than the frames would fill the log.
        if not member.dropped:
            algorithm.out.log(
                member.name,
                "event queue full: "
                f"{algorithm.inbox.max_waiting} events wait for a frame; dropping further events",
            )
        member.dropped += sum(map(len, emitted.events))

    def order(self, order: s.Publish) -> None:
        """Accept an event from a person for the next frame."""
        self._algorithm.inbox.add_order(order.event, order.person)

    def _may_generate(self, member: MemberEntry, events: tuple[AnyEvent, ...]) -> bool:
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
        if not (reason or light) and self._algorithm.in_flight.logged is None:
            work = self._algorithm.inbox.work
            reason = work.objection(events, work.most_of_generator, "single_events")
        if not reason and member.hello is not None:
            # The process that makes these events may have joined after the guest.
            reason = refusal_of_guest(self._algorithm, member.hello, map(_TYPE, events))
        if reason:
            self._algorithm.joining.violation(s.Violation(member.name, reason))
        return not reason

    # --- steps 2 to 4 ---

    def collect(self) -> None:
        """Steps 2 to 4: e*, e^v and e^u."""
        algorithm = self._algorithm
        in_flight = algorithm.in_flight
        due = due_views(algorithm.members.index, algorithm.frame, in_flight.clock_views)
        later: Mapping[str, Sequence[AnyEvent]]
        if in_flight.logged is None:
            later = algorithm.inbox.hold_back()
        else:  # Logged events were few enough for one frame.
            later = in_flight.logged.waiting
            # The devices that requested these views may be absent now.
            due = tuple(sorted({*due, *in_flight.logged.due}))
        self._gather(due)
        if later:
            algorithm.inbox.put_back(later)

    def _gather(self, due: tuple[str, ...]) -> None:
        algorithm, events = self._algorithm, self._algorithm.in_flight.events
        taken, emitted = algorithm.inbox.take(self._has_taker), algorithm.inbox.emitted
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
        if algorithm.world.speaks_for:
            # The rights were checked on arrival, but the string may have changed since then.
            self._leave_out_foreign(sources)
        if due:
            sources[DEVICES] = visual_events(algorithm, due)
        if algorithm.world.norms:
            logged = algorithm.in_flight.logged
            events.people = algorithm.members.standing_for_people(sources, logged)
        allowed = self._permitted(sources)
        if allowed:
            events.allowed = allowed
            ordered = collect(algorithm.world.order, allowed)
            events.split(ordered, algorithm.world.vocabulary.events)
        if events.dropped:
            leave_out(algorithm, events.dropped)

    def _add_ticked(self, sources: dict[str, Sequence[AnyEvent]]) -> None:
        """Add the events of members in step, and keep their saved data."""
        saved = self._algorithm.members.saved
        for member, reply in self._algorithm.in_flight.ticked.items():
            if reply.events:
                sources[member] = [*reply.events, *sources.get(member, ())]
            if reply.saved is not None or member in saved:
                # A successor of a member that no longer saves data must not
                # continue from outdated ones.
                saved[member] = NOTHING if reply.saved is None else reply.saved

    def _leave_out_foreign(self, sources: dict[str, Sequence[AnyEvent]]) -> None:
        """Drop events whose sender is not, or no longer, an agent that the source may represent."""
        algorithm = self._algorithm
        for name in sorted(sources.keys() & algorithm.world.speaks_for.keys()):
            kept = self._speaking.kept(name, sources[name])
            dropped = sum(map(len, sources[name])) - sum(map(len, kept))
            sources[name] = kept
            if dropped:
                member = algorithm.members.get(name)
                if not member.dropped:
                    gone = "from agents that are not in the string"
                    algorithm.out.log(
                        name, f"sent {dropped} events {gone}; such events are left out"
                    )
                member.dropped += dropped

    # --- norms on events ---

    def _permitted(self, sources: dict[str, Sequence[AnyEvent]]) -> dict[str, Sequence[AnyEvent]]:
        """The events that norms permit, and the sanctions that follow from the last frame."""
        algorithm = self._algorithm
        # Taken out first, because the sanctions that `publish` adds below belong to the next frame.
        # They are not judged themselves: no norm can prevent the sanction of another.
        sanctions = algorithm.inbox.take_sanctions()
        if algorithm.world.norms:
            people = algorithm.in_flight.events.people
            sources = dict(algorithm.norms.events(algorithm.frame, sources, people))
            algorithm.norms.publish(algorithm.out, algorithm.inbox, algorithm.members.saved)
        self._report_orders(sources)
        return {**sources, SOURCE: sanctions} if sanctions else sources

    def _permitted_orders(self, orders: OrdersBySource) -> tuple[AnyEvent, ...]:
        """People's orders that norms permit, before a generator takes them."""
        algorithm, permitted = self._algorithm, orders
        if algorithm.world.norms:
            permitted = algorithm.norms.events(algorithm.frame, orders)
            algorithm.norms.publish(algorithm.out, algorithm.inbox, algorithm.members.saved)
        self._report_orders(permitted)
        return tuple([event for source in sorted(permitted) for event in permitted[source]])

    def _report_orders(self, permitted: OrdersBySource) -> None:
        """Report the orders that norms reject, which norms log, and those that count."""
        frame, out = self._algorithm.frame, self._algorithm.out
        for source, event, norm in self._algorithm.norms.take_rejected_orders():
            out.add(s.OrderJudged(event, name_of(source), frame, norm))
        for source in sorted(filter(is_people, permitted)):
            for event in permitted[source]:
                out.log(ORDERS, f"{counting(source, event)} in frame {frame}")
                if isinstance(event, Event):  # Programs send batches, and do not ask for fates.
                    out.add(s.OrderJudged(event, name_of(source), frame))


def visual_events(algorithm: FrameAlgorithm, due: Sequence[str]) -> tuple[Event, ...]:
    """The visual events that devices generate, without data or receivers."""
    types = algorithm.world.vocabulary.events
    return tuple([types[event_type]() for event_type in due])


def leave_out(algorithm: FrameAlgorithm, sources: Sequence[str]) -> None:
    """Leave all events of some sources out of the frame in flight; its inputs keep them apart."""
    world, in_flight = algorithm.world, algorithm.in_flight
    events = in_flight.events
    for source in sources:
        reply, sent = in_flight.ticked.get(source), events.taken.pop(source, ())
        if reply is not None:
            sent = [*reply.events, *sent]
            in_flight.ticked[source] = replace(reply, events=(), received=b"")
        events.taken[DROPPED + source] = sent
    events.dropped = tuple(sources)
    events.allowed = {name: sent for name, sent in events.allowed.items() if name not in sources}
    events.split(collect(world.order, events.allowed), world.vocabulary.events)


def note_answer(algorithm: FrameAlgorithm, member: MemberEntry) -> None:
    """Note that a member has answered, so that it is no longer late."""
    member.last_reply = algorithm.frame
    if member.state is MemberState.LATE:
        algorithm.members.change(member, MemberChange.ANSWERED)
