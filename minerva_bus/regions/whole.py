"""The coordinator of a world in regions: it times their frames and assembles the whole string.

For this coordinator each region is a member in step. A frame is requested by `tick`, and complete
when all regions have reported it; the string is merged from their parts, and no agent evolves here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.errors import ProtocolError, SceneError, VocabularyError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import CollectionStep, note_answer, visual_events
from minerva_bus.frame.event_sources import AGENTS, DEVICES
from minerva_bus.frame.inputs import FrameInputs, RecordedFrame
from minerva_bus.frame.lag import saved_strays
from minerva_bus.frame.live import why_over
from minerva_bus.frame.member_states import MemberEntry
from minerva_bus.frame.own_agents import NO_AGENTS, OwnAgents
from minerva_bus.frame.phases import Phase
from minerva_bus.frame.replaying import RecordedSource
from minerva_bus.frame.views import due_views
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.regions import beside
from minerva_bus.regions.dividing import cut
from minerva_bus.regions.emissions import SentEvents
from minerva_bus.regions.generated import GeneratedEvents
from minerva_bus.regions.journal import JOURNAL, PROCESS, KeptJournals
from minerva_bus.regions.judging import log_violations, permitted_events
from minerva_bus.regions.last_views import LastViews
from minerva_bus.regions.merging import agents_in
from minerva_bus.regions.messages import check_given_up
from minerva_bus.regions.part import PartCodec, PartMessage, PartReceiver, targets_of
from minerva_bus.regions.partition import Partition
from minerva_bus.regions.requesting import PARCELS, FrameRequests
from minerva_bus.regions.schedule import Schedule
from minerva_bus.regions.whole_string import WholeString, saved_parts
from minerva_bus.world.kinds import Kinds
from minerva_bus.world.norms import SOURCE
from minerva_bus.world.order import collect

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm

PART = "part"
"""Key of the report in the saved data of a region's `ticked`."""

FIRST = 0
"""The region that reports the events of generators, which are equal in all regions."""

PARTS: Final = "~parts"
JOURNALS: Final = "~journals"
"""Keys in the saved data of a journal for the parts of all regions, and for the journals that the
coordinator keeps for them; no member can have these names."""


class WholeSource(RecordedSource):
    """The frames of a world whose agents evolve in regions.

    `names` are the members that are the regions, by number; `kinds` make the views, if they are
    `all_kinds`, not only those in Python; regions that join get the `terms` and their first
    `journals`, as saved data; they run `ahead` by so many frames, with `services` in them. Instead
    of a `partition`, a successor has the parts in its journal, and repeats the last requests.
    """

    # Other regions may wait for the parcels of one that has returned after its report.
    admits_at_once = True

    def __init__(
        self,
        algorithm: FrameAlgorithm,
        *,
        partition: Partition | None = None,
        names: Sequence[str],
        kinds: Kinds,
        all_kinds: bool = True,
        codec: PartCodec,
        terms: Mapping[str, Any] | None = None,
        journals: Mapping[str, bytes] | None = None,
        ahead: int = 0,
        services: Sequence[m.Hello] = (),
    ) -> None:
        """Raises ProtocolError if the parts in the journal are damaged."""
        self._names = {name: number for number, name in enumerate(names)}
        self._codec = codec
        self._terms, self._all_kinds = terms or {}, all_kinds
        saved = algorithm.members.saved
        self._journals = KeptJournals(saved.pop(JOURNALS, journals or {}))
        if PARTS in saved:
            self._whole = WholeString(saved_parts(saved.pop(PARTS), names, codec))
        else:
            assert partition is not None
            parts = cut(algorithm.world.scene, partition, saved_strays(saved))
            self._whole = WholeString(map(PartReceiver, parts))
        super().__init__(algorithm, cursor=self._whole, kinds=kinds)
        algorithm.members.inside = tuple(services)
        parcels, schedule = saved.pop(PARCELS, None), Schedule.of(algorithm.world.lag, ahead)
        self._requests = FrameRequests(algorithm, schedule, partition, parcels)
        self._last_views = LastViews(algorithm, self._requests, self._names, self._targets)
        self._reports: dict[str, PartMessage] = {}
        self._replies: list[m.TickReply] = []
        self._sent = SentEvents(algorithm)
        self._generated = GeneratedEvents()
        self.emitted = CollectionStep(algorithm).emitted

    def journaled(self) -> Mapping[str, Mapping[str, Any]]:
        """The parts of all regions, as reports of regions that had nothing before; journals."""
        parts = self._whole.saved(self._algorithm.frame, [*self._names], self._codec)
        return {PARTS: parts, JOURNALS: self._journals.all(), PARCELS: self._requests.saved}

    def saved_for(self, member: str) -> Mapping[str, Any] | None:
        """The terms and the kept journal of a region, or what another member has saved."""
        if member not in self._names:
            return super().saved_for(member)
        self._requests.forget(member)
        journal, process = self._journals.of(member), self._algorithm.members.get(member).joins
        kept = {} if journal is None else {JOURNAL: journal}
        return {**self._terms, PROCESS: process, **kept}

    # --- a frame ---

    def has_next(self) -> bool:
        """Whether a frame can begin: always, until the world is over."""
        return True

    @property
    def at_rest(self) -> bool:
        """Whether the next frame would change nothing in any region."""
        parts = self._whole.parts
        return self._requests.at_rest and all(each.resting and not each.for_all for each in parts)

    def begin(self) -> None:
        """Request a frame of all regions, with the events from outside of them, and later ones."""
        algorithm, logged = self._algorithm, self._algorithm.in_flight.logged
        if logged is not None:
            self._requests.outside.load(logged.taken, logged.waiting)
            for reply in logged.reports:
                self._accept(reply)
            return
        algorithm.in_flight.pending = set(self._names)
        for reply in self._requests.begin(tuple(part.for_all for part in self._whole.parts)):
            self.tick_reply(reply)

    def ask(self, member: MemberEntry) -> None:
        """Repeat the requests to a region that has returned."""
        for request in self._requests:
            self._algorithm.out.send(member.name, request)

    def members_changed(self, hello: m.Hello | None) -> None:
        """Repeat the requests of frames that have not begun to a region that has returned."""
        super().members_changed(hello)
        if hello is None or self._algorithm.awaits_tick(hello.member):
            return
        self._last_views.returned(hello.member)
        for request in self._requests:
            if hello.member in self._names and self._requests.is_early(request.frame):
                self._algorithm.out.send(hello.member, request)

    def agents_of(self, member: str) -> OwnAgents:
        """The agents about which a region reports: all, since any may have moved to it."""
        if member not in self._names:
            return NO_AGENTS
        return agents_in(lambda: (part.units for part in self._whole.parts))

    def objection(self, hello: m.Hello) -> str:
        """Reason why a member, which is not a region, cannot take part; or an empty string."""
        is_region = hello.member in self._names
        return "" if is_region else beside.objection(hello, makes_all_views=self._all_kinds)

    def early_replies(self, member: str) -> int:
        """The frames ahead that a region has not reported."""
        return self._requests.outstanding(member) if member in self._names else 0

    def tick_reply(self, reply: m.TickReply) -> None:
        """Accept the report of a region, or keep that of a later frame."""
        algorithm = self._algorithm
        member = algorithm.members.get(reply.member)
        # That of a former process may arrive after the next one has joined, and repeats its frame.
        is_own = (reply.saved or {}).get(PROCESS) == member.joins
        reports = member.active and reply.member in self._names and is_own
        if reports and self._requests.is_early(reply.frame):
            self._requests.keep(reply)
            return
        awaited = algorithm.awaits_tick(reply.member) and reply.frame == algorithm.frame
        is_last = self._last_views.awaits(reply)
        if not (reports and (awaited or is_last)):
            member.late += 1
            return
        try:
            if is_last:
                self._last_views.accept(reply)
                return
            self._accept(reply)
        except (ProtocolError, SceneError) as error:
            algorithm.joining.violation(s.Violation(reply.member, str(error)))
            return
        log_violations(algorithm, reply)
        note_answer(algorithm, member)
        algorithm.in_flight.pending.discard(reply.member)

    def _decoded(self, reply: m.TickReply) -> PartMessage:
        data = (reply.saved or {}).get(PART)
        if not isinstance(data, bytes) or reply.member not in self._names:
            raise ProtocolError(f"ticked: a region must report its {PART}")
        return self._codec.decode(data, self.agents_of(reply.member))

    def _targets(self, reply: m.TickReply) -> Sequence[int]:
        return targets_of(self._decoded(reply))

    def _accept(self, reply: m.TickReply) -> None:
        """Continue with a region's report. Raises ProtocolError and SceneError."""
        message = self._decoded(reply)
        check_given_up(message.given_up)
        number = self._names[reply.member]
        first = number == FIRST
        if first or message.inputs:
            inputs = self._codec.inputs(message.inputs)
            self._generated.add(reply.member, inputs, message.answered, first=first)
        self._whole.parts[number].apply(message)
        received = (reply.saved or {}).get(JOURNAL)
        if isinstance(received, bytes) and received:
            self._journals.add(reply.member, received)
        self._reports[reply.member] = message
        self._replies.append(reply)

    def order(self, order: s.Publish) -> None:
        """Accept an event from a person for the next frame."""
        self._algorithm.inbox.add_order(order.event, order.person)

    def ordered(self) -> Mapping[str, Sequence[AnyEvent]]:
        """Events outside of all complete frames."""
        return self._requests.outside.noted(in_frame=self._algorithm.in_frame)

    def wait_with(self, events: Mapping[str, Sequence[AnyEvent]]) -> None:
        """Continue with what a predecessor has noted as `ordered`."""
        self._requests.outside.resume(events)

    def collect(self) -> None:
        """Steps 2 to 4: the events of all regions in the order of one coordinator."""
        algorithm, inbox = self._algorithm, self._algorithm.inbox
        inputs = self._generated.take()
        people = self._people_of(inputs)
        sources = permitted_events(algorithm, inputs, people)
        if sent := self._sent.take():
            sources[AGENTS] = sent
        if inbox.sanctions:
            sources[SOURCE] = inbox.take_sanctions()
        for name, reply in inputs.ticked.items():
            if reply.saved is not None:
                algorithm.members.saved[name] = reply.saved
        due = tuple(sorted({*inputs.due, *self._due()}))
        if due:
            sources[DEVICES] = visual_events(algorithm, due)
        events = collect(algorithm.world.order, sources)
        waiting = {source: tuple(sent) for source, sent in inbox.events.items()}
        reports = tuple(self._replies)
        logged = replace(inputs, due=due, waiting=waiting, reports=reports, people=people)
        self._whole.ahead = RecordedFrame(algorithm.frame, events, [], b"", 0.0, logged)
        super().collect()

    def _people_of(self, inputs: FrameInputs) -> tuple[str, ...]:
        logged = self._algorithm.in_flight.logged
        outside = self._requests.people if logged is None else logged.people
        return tuple(sorted({*inputs.people, *outside}))

    def _due(self) -> tuple[str, ...]:
        """The views that observers of the whole request, and those in the journal."""
        algorithm, in_flight = self._algorithm, self._algorithm.in_flight
        due = due_views(algorithm.members.index, algorithm.frame, in_flight.clock_views)
        return due if in_flight.logged is None else (*due, *in_flight.logged.due)

    def _visual(self, *, closing: bool) -> tuple[AnyEvent, ...]:
        """The views to make here: regions make those for the devices in region 0."""
        algorithm, clock = self._algorithm, self._algorithm.in_flight.clock_views
        due = due_views(algorithm.members.index, algorithm.frame, clock, closing=closing)
        return visual_events(algorithm, due)

    def evolve(self) -> None:
        """Steps 5 and 6: views here, and, when the world is over, in all regions."""
        super().evolve()
        self._last_views.request()

    def ask_again(self, fragments: list[str]) -> None:
        """Wait for regions that are gone before services have seen the last views."""
        self._last_views.again(fragments)

    def stop(self, phase: Phase) -> None:
        """Tell regions to show the views of the last frame, if a person ends the world."""
        self._last_views.stop(phase)

    def commit(self) -> None:
        """Step 8: continue with the string of all parts."""
        algorithm, goal = self._algorithm, self._algorithm.goal
        for report in self._reports.values():
            goal.learn(report.reached, report.striving, report.given_up)
        self._sent.note(self._whole.parts)
        self._reports, self._replies = {}, []
        self._requests.done(part.targets for part in self._whole.parts)
        try:
            super().commit()
        except VocabularyError as error:
            algorithm.fail(f"frame {algorithm.frame}: {error}")
            return
        self._sent.queue()
        if algorithm.in_flight.result.changed:
            algorithm.views.last_change = algorithm.frame

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        algorithm = self._algorithm
        empty, finished = algorithm.composition.empty, algorithm.goal.finished
        return why_over(algorithm.world, algorithm.frame, empty, finished)

    def announce(self) -> None:
        """Step 10: announce that the next frame may begin."""
        self._algorithm.out.add(s.Ready(self._algorithm.frame))

    def seek(self, frame: int) -> None:
        """Do nothing: a running world has no other frames."""
