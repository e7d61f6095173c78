"""Steps 5, 6 and 8 of Table 2: requests to hosts, replies, norms, and the next string.

A host may only report on the fragments that were requested from it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping
from functools import partial
from operator import attrgetter, itemgetter
from typing import Final

import numpy as np

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection_step import FrameInbox, report_dropped
from minerva_bus.frame.composition import Composition, applied, first_in, ids_of
from minerva_bus.frame.member_table import Members
from minerva_bus.frame.norm_rejections import Norms, Trial
from minerva_bus.frame.placement import Offers, Placement
from minerva_bus.frame.sender_rights import are_light
from minerva_bus.frame.stimuli import (
    AGENTS,
    HALTED,
    FrameInputs,
    Instructions,
    is_people,
    person_of,
)
from minerva_bus.frame.view_streams import Views
from minerva_bus.frame.world_state import FrameInFlight, FrameResult, Phase, Progress, WorldSpec
from minerva_bus.grammar.columns import Columns, Delta, packed
from minerva_bus.grammar.events import AnyEvent, Event, senders_of
from minerva_bus.grammar.ids import MAX_SHOWN, Ids, row_delta_of_ids
from minerva_bus.grammar.scene import AgentNode, Scene, agents
from minerva_bus.grammar.types import Unfit
from minerva_bus.world.population import copy_id

_AGENT: Final[Callable[[tuple[str, str]], str]] = itemgetter(0)


def changed_fragments(
    reply: m.EvolveReply, composition: Composition, views: Views
) -> dict[str, Scene]:
    """The changed fragments of a reply, with deltas applied.

    Raises Unfit if its deltas do not fit the string, or its views the last ones.
    """
    former = {
        name: Scene((composition.fragments[name],))
        for name, change in reply.changed.items()
        if isinstance(change, Delta) and name in composition.fragments
    }
    try:
        changed = applied(former, reply.changed)
        for event_type, changes in reply.views.items():
            views.check(event_type, changes)
    except Unfit as unfit:
        raise Unfit(f"it sent {unfit}, which do not match the string") from None
    # A host that declines columns returns a part node by node; the composition holds columns.
    for name in sorted(changed.keys() & composition.parts.keys()):
        changed[name] = packed(changed[name])
    return changed


def foreign_fragment(reply: m.EvolveReply, asked: Collection[str]) -> str:
    """Reason for rejecting a reply about fragments that were not requested, or empty."""
    named = set(reply.changed).union(*reply.views.values())
    for fragment in sorted(named.difference(asked)):
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


def claim_ids(changed: Mapping[str, Scene], result: FrameResult, composition: Composition) -> None:
    """Note the agents of changed fragments, each of which has no id twice.

    Raises Unfit for an id that belongs to another fragment, by the string before the frame or by an
    earlier reply: then nothing is noted.
    """
    single, gained = _reported(changed, composition.parts)
    if not (single or gained):
        return
    homes = composition.home_of_each(map(_AGENT, single)) if single else {}
    owners = homes | result.newborns
    for agent, fragment in single:
        if owners.setdefault(agent, fragment) != fragment:
            raise _second(agent)
    born = result.born.copy()
    if born:  # The owners are without them, because most frames have no need of their texts.
        gained += [(fragment, Ids.of([who])) for who, fragment in single if who not in homes]
    for fragment, ids in gained:
        others = [other for home, other in born if home != fragment]
        twice = composition.elsewhere(ids, fragment, owners) or first_in(ids, others)
        if twice:
            raise _second(twice)
        born.append((fragment, ids))
    result.newborns.update(single)
    result.born = born


def _second(agent: str) -> Unfit:
    return Unfit(f"it made a second agent #{agent[:MAX_SHOWN]}")


def _reported(
    changed: Mapping[str, Scene], parts: Mapping[str, Columns]
) -> tuple[list[tuple[str, str]], list[tuple[str, Ids]]]:
    """The agents outside columns and the ids that columns have gained, with their fragments.

    An agent that is a fragment of the string is left out: nothing else may have its id.
    """
    single: list[tuple[str, str]] = []
    gained: list[tuple[str, Ids]] = []
    for fragment, scene in sorted(changed.items()):
        for piece in scene.pieces:
            if piece.ids is not None:
                part = parts.get(fragment)
                # Without births and deaths the ids are the same object.
                if part is None or piece.ids is not part.ids:
                    gained.append((fragment, _gained(part, piece.ids)))
            # The usual case, without a stack for each agent.
            elif isinstance(piece, AgentNode) and not piece.scope.pieces:
                if piece.id != fragment:
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
    own = senders_of(event)
    return own is not None and bool((part.ids.rows_of(own) >= 0).all())


_TYPE: Final = attrgetter("type")

BALANCE_INTERVAL: Final = 32
"""Frames between two checks whether other shares of the hosts would be faster."""


class EvolutionStep:
    """Lets hosts evolve and visualize their fragments, and builds the next string."""

    def __init__(
        self,
        world: WorldSpec,
        now: Progress,
        members: Members,
        composition: Composition,
        placement: Placement,
        views: Views,
        inbox: FrameInbox,
        norms: Norms,
        out: Instructions,
    ) -> None:
        self._world = world
        self._now = now
        self._members = members
        self._composition = composition
        self._placement = placement
        self._views = views
        self._inbox = inbox
        self._norms = norms
        self._out = out
        self._trial: Trial | None = None
        self._stages: Iterator[tuple[AnyEvent, ...]] = iter(())

    def _offers(self) -> Offers:
        return self._members.allowed_offers(self._world.placement)

    # --- requests ---

    def evolve(self) -> None:
        """Steps 5 and 6: request w_next = η(w, e^u) and v = π(w, e^v) from all hosts concerned."""
        in_flight = self._now.in_flight
        requests = in_flight.requests
        self._trial = None
        if in_flight.logged is not None and in_flight.logged.complete:
            # Logged replies name fragments of the layout that their coordinator had chosen.
            self._composition.lay_out(in_flight.logged.layout)
            requests.layout = in_flight.logged.layout
            requests.left_out.update(in_flight.logged.left_out)
            return
        placement = self._placement
        # Also after 1, 2, 4, ... frames, so that a short run of slow agents is divided early.
        due = self._now.frame % BALANCE_INTERVAL == 0 or self._now.frame.bit_count() == 1
        if placement.outdated or (due and placement.imbalanced):
            self._arrange()
        requests.layout = self._composition.layout
        hosts, events = self._hosts_to_ask(), in_flight.events
        if not hosts:
            return
        for host in hosts:
            requests.outstanding[host, 0] = placement.fragments_of(host)
            # Fragments are sent before the request that needs them;
            # messages keep their order on the bus.
            self._give(host)
        # Those that decline columns get a message of their own.
        plain = tuple(filter(self._members.declines_columns, hosts))
        # One publication for all hosts with counted replies was the fastest pattern measured.
        others = tuple([host for host in hosts if host not in plain]) if plain else hosts
        if others:
            request = m.EvolveRequest(self._now.frame, others, events.evolving, events.visual)
            self._out.pending.append(s.Send(s.HOSTS, request))
        for host in plain:
            only = requests.outstanding[host, 0]
            request = m.EvolveRequest(
                self._now.frame, (host,), events.evolving, events.visual, only=only
            )
            self._out.send(host, request)

    def _arrange(self) -> None:
        """Assign all fragments to hosts, and log what has none."""
        placement = self._placement
        placement.outdated = False
        placement.arrange(self._offers())
        rules = bool(self._world.placement.rules)
        # Agents without a host do not evolve. This is not an error, so the log must mention them.
        placement.log.count(placement.unassigned_agents, rules=rules, out=self._out)
        offers = self._members.offers().values()
        placement.log.kinds(offers, placement.unassigned.values(), self._out)

    def _hosts_to_ask(self) -> tuple[str, ...]:
        """The hosts that this frame concerns; fragments without a host wait or keep their state."""
        placement = self._placement
        events = self._now.in_flight.events
        everyone = self._world.policy.rules.without_events and self._now.phase is Phase.EVOLVE
        if not (everyone or events.evolving or events.visual):
            return ()
        if placement.unassigned:
            self._wait_or_leave_out(placement.unassigned)
        if everyone:  # Agents then change whether or not an event concerns them.
            return tuple(placement.occupied)
        return tuple(placement.concerned(events.evolving, events.visual))

    def _give(self, host: str) -> None:
        """Send a host the fragments that it lacks."""
        lacking = self._placement.lacking(host)
        if lacking is not None:
            self._out.send(host, lacking)

    def _wait_or_leave_out(self, unassigned: Mapping[str, frozenset[str]]) -> None:
        """Wait for a host of these fragments if one is awaited; otherwise leave them out."""
        requests = self._now.in_flight.requests
        awaited = self._members.awaited_kinds()
        for fragment, kinds in unassigned.items():
            if kinds <= awaited:
                requests.unassigned.add(fragment)
            else:
                requests.left_out.add(fragment)

    def ask_again(self, fragments: list[str]) -> None:
        """Request fragments once more in this frame, from their current hosts."""
        placement = self._placement
        # The arrangement within a frame ignores this limit, so the next frame has to restore it.
        placement.outdated = self._world.placement.agents_per_host > 0
        placement.arrange(self._offers(), mid_frame=True)
        self._now.in_flight.requests.unassigned = set()
        unassigned = placement.unassigned
        self._wait_or_leave_out({n: unassigned[n] for n in fragments if n in unassigned})
        self._repeat_request(fragments)

    def _repeat_request(self, fragments: Iterable[str]) -> None:
        in_flight = self._now.in_flight
        by_host: dict[str, list[str]] = {}
        for fragment in fragments:
            host = self._placement.host_of(fragment)
            if host is not None:
                by_host.setdefault(host, []).append(fragment)
        requests, events = in_flight.requests, in_flight.events
        # Fragments of a host that is lost after a rejection are evolved by the reduced events, too.
        evolving, visual = requests.reduced or (events.evolving, events.visual)
        for host, only in sorted(by_host.items()):
            requests.repeats += 1
            requests.outstanding[host, requests.repeats] = tuple(only)
            self._give(host)
            request = m.EvolveRequest(
                self._now.frame, (host,), evolving, visual, requests.repeats, tuple(only)
            )
            self._out.send(host, request)

    def lighten(self, host: str) -> bool:
        """Repeat a frame that has ended a host twice, without the events of guests and people.

        Returns False if there are none, or if norms have judged the first results: nothing happens.
        """
        in_flight = self._now.in_flight
        requests, allowed, work = in_flight.requests, in_flight.events.allowed, self._inbox.work
        if not allowed:
            return False
        worst = max(allowed, key=lambda name: max(map(work.steps, allowed[name]), default=0))
        again = self._trial is None and in_flight.logged is None
        guests = sorted(filter(self._members.is_guest, allowed)) if again else []
        names = ", ".join(map(_who, guests))
        then = f"repeated without the events of {names}" if guests else "tried again as it is"
        # Without guests, an error of its code that has been logged is the reason.
        if guests or not self._members.get(host).blamed:
            self._out.log(
                host,
                f"its process ended twice in frame {self._now.frame}, perhaps by too many events:"
                f" {work.heaviest(allowed[worst])}, from {_who(worst)}; the frame is {then}",
            )
        if not guests:
            return False
        for name in guests:
            if not is_people(name):
                self._members.get(name).dropped += sum(map(len, allowed[name]))
        report_dropped(self._out, guests, allowed, self._now.frame, host)
        in_flight.leave_out(guests, self._world.order, self._world.vocabulary.events)
        requests.cancel()
        requests.left_out.clear()
        in_flight.result = FrameResult()
        # Some hosts have evolved them by the events that no longer count.
        for fragment in self._composition.fragments:
            self._placement.resend(fragment)
        self._placement.arrange(self._offers(), mid_frame=True)
        hosts = self._hosts_to_ask()
        self._repeat_request(
            [name for host in hosts for name in self._placement.fragments_of(host)]
        )
        return True

    # --- replies ---

    def reply(self, reply: m.EvolveReply) -> str:
        """Accept a host's results for its fragments; returns the reason for a violation."""
        requests = self._now.in_flight.requests
        member = self._members.entries[reply.member]
        key = (reply.member, reply.part)
        if reply.frame != self._now.frame or key not in requests.outstanding or not member.active:
            member.late += 1
            return ""
        # The whole reply is checked before any part of it counts, so a
        # violation leaves the frame as it was.
        if wrong := self._objection(reply, frozenset(requests.outstanding[key])):
            return wrong
        try:
            changed = self._merge(reply)
        except Unfit as unfit:
            return str(unfit)
        del requests.outstanding[key]
        self._members.answered(member, self._now.frame)
        # A repeated request concerns a few fragments only; its
        # duration is not the speed of the host.
        if reply.elapsed and not reply.part:
            self._placement.note_elapsed(reply.member, reply.elapsed)
        self._now.in_flight.result.changed_by.update(dict.fromkeys(changed, reply.member))
        return ""

    def _merge(self, reply: m.EvolveReply) -> dict[str, Scene]:
        """Merge a reply into the result, and return its changed fragments. Raises Unfit."""
        result = self._now.in_flight.result
        changed = changed_fragments(reply, self._composition, self._views)
        # After all other checks, because a refused reply claims nothing.
        claim_ids(changed, result, self._composition)
        result.merge(reply, changed)
        return changed

    def _objection(self, reply: m.EvolveReply, asked: frozenset[str]) -> str:
        """Reason for rejecting a reply, or an empty string."""
        composition, in_flight = self._composition, self._now.in_flight
        reason = foreign_fragment(reply, asked)
        for name, events in sorted(reply.emitted.items()):
            reason = reason or foreign_sender(
                name, events, self._sender_names(name), asked, composition
            )
        # A frame that is computed again has been within the limits of its own run.
        if reply.emitted and not reason and in_flight.logged is None:
            sent = [event for events in reply.emitted.values() for event in events]
            if not are_light(sent):
                reason = self._inbox.work.objection_to_host(sent)
        if not reason and reply.views:
            # Only the first request is about views: a second one of an agent would not fit.
            reduced, visual = in_flight.requests.reduced, in_flight.events.visual
            unasked = reply.views.keys() - set(map(_TYPE, visual if reduced is None else ()))
            reason = f"it sent a view of {min(unasked)}, which was not requested" if unasked else ""
        return reason

    def _sender_names(self, agent: str) -> frozenset[str]:
        """The ids under which an agent sends; under some policies its copies' too."""
        if not self._world.policy.rules.makes_copies:
            return frozenset((agent,))
        events = self._now.in_flight.events.evolving
        copies = range(2, 1 + sum(map(len, events)))
        return frozenset((agent, *(copy_id(agent, self._now.frame, copy) for copy in copies)))

    def _merge_logged(self, inputs: FrameInputs) -> None:
        """Merge the logged replies to the latest request. Raises Unfit."""
        result = self._now.in_flight.result
        begin, requests = len(result.replies), len(result.answers)
        end = begin + sum(inputs.answers[requests : requests + 1])
        for reply in inputs.replies[begin:end]:
            self._merge(reply)

    # --- norms ---

    def settle(self) -> bool:
        """Whether the results are final; if norms reject some, repeat with fewer events."""
        in_flight = self._now.in_flight
        # A stage may have no outstanding replies: the fragments no longer have a host, or their
        # logged replies are present already. Then the next stage follows at once.
        while True:
            if in_flight.logged is not None:
                self._merge_logged(in_flight.logged)
            # Succession feeds the replies stage by stage, so their number in each must be logged.
            result = in_flight.result
            result.answers.append(len(result.replies) - sum(result.answers))
            if self._world.norms:
                self._judge()
            stage = next(self._stages, None) if self._trial is not None else None
            if stage is None or self._trial is None:
                if self._trial is not None or in_flight.events.visual:
                    self._enforce()
                return True
            # No visual events: the views are of the string before the frame, which no norm changes.
            in_flight.requests.reduced = stage, ()
            rejected = self._trial.open
            for fragment in rejected:
                self._placement.resend(fragment)
            self._repeat_request(rejected)
            if in_flight.requests.outstanding:
                return False

    def _judge(self) -> None:
        """Apply norms to results, those of the first request or those by fewer events."""
        in_flight = self._now.in_flight
        result = in_flight.result
        if in_flight.requests.reduced is None:
            self._trial = self._norms.agents(self._now.frame, result.changed, result.sent)
            self._inbox.sanctions += self._norms.publish(self._out, self._members.saved)
            if self._trial is not None:
                # A generator, because further stages are needed only while agents are rejected.
                self._stages = self._trial.stages(in_flight.events.evolving)
        elif self._trial is not None:
            self._trial.reconsider(result.changed, result.sent)
        if self._trial is not None:
            # The trial has copies; from now on the result gathers the
            # replies to the next stage alone.
            result.changed, result.sent = {}, {}

    def _enforce(self) -> None:
        """Replace the results by the permitted ones; rejected agents are halted."""
        in_flight = self._now.in_flight
        result = in_flight.result
        # The view shows an action of these agents that λ has not counted, because they did not
        # evolve. A device that executes it would move a body that does not move in the string.
        halted = set(self._agents_left_out() if in_flight.events.visual else ())
        if self._trial is not None:
            halted.update(self._trial.settle(result))
        # Devices get this list instead of a corrected view, which would cost another round trip,
        # and which nothing could compute for an agent whose host is away.
        result.halted = tuple(sorted(halted))
        if halted:  # A resumed world needs this, because its devices act on the last view.
            halted_state = {"frame": self._now.frame, "agents": list(result.halted)}
            self._members.saved[HALTED] = halted_state

    def _agents_left_out(self) -> Iterator[str]:
        """The agents that no host has evolved in this frame although events were for them."""
        fragments = self._composition.fragments
        for name in self._now.in_flight.requests.left_out & fragments.keys():
            fragment = fragments[name]
            if fragment.ids is not None:
                yield from fragment.ids.texts()
            else:
                yield from (agent.id for agent in agents(Scene((fragment,))))

    # --- step 8 ---

    def commit(self) -> None:
        """Step 8: make the results the next string."""
        in_flight = self._now.in_flight
        result, inbox = in_flight.result, self._inbox
        # Before the replacement, because an agent that died in this frame has no place after it.
        sent = self._sent_in_order() if result.sent else []
        if result.changed or result.rejected:
            self._placement.outdated |= self._composition.replace(result.changed)
            self._note_holders()
        frame, events, requests = self._now.frame, in_flight.events, in_flight.requests
        inputs = FrameInputs(
            frame,
            due=events.due,
            ticked=in_flight.ticked,
            taken=events.taken,
            layout=requests.layout,
            replies=result.replies,
            waiting=inbox.events,
            people=events.people,
            answers=tuple(result.answers),
            left_out=tuple(sorted(requests.left_out)),
        )
        record = partial(frame_record, frame, in_flight, self._composition)
        self._out.pending.append(s.FrameDone(frame, record, events.ordered, inputs))
        self._now.frame += 1
        inbox.end_frame(sent)
        if result.changed:
            self._views.last_change = self._now.frame

    def _note_holders(self) -> None:
        """Note which hosts hold the current state of changed fragments; others get them again."""
        result, placement = self._now.in_flight.result, self._placement
        for fragment, scene in result.changed.items():
            if fragment in result.rejected:
                continue
            host = result.changed_by.get(fragment)
            if host is not None:
                placement.changed(host, fragment, scene)
            else:  # Its host is gone, and the next one may have the former state.
                placement.resend(fragment)
        for fragment in result.rejected:
            placement.resend(fragment)

    def _sent_in_order(self) -> list[AnyEvent]:
        """The events that agents sent, in the order of the agents in the string."""
        sent = self._now.in_flight.result.sent
        places = self._composition.places(sent)
        return [event for name in sorted(sent, key=places) for event in sent[name]]


def _who(source: str) -> str:
    """A source of events, for the log."""
    return person_of(source) if is_people(source) else "agents" if source == AGENTS else source


def frame_record(frame: int, in_flight: FrameInFlight, composition: Composition) -> m.FrameRecord:
    """The record of a frame that has just been committed; it has the digest of the string."""
    changed = in_flight.result.changed
    return m.FrameRecord(frame, in_flight.events.ordered, changed, composition.scene.digest)
