"""A region as a member of its world: the coordinator requests frames, regions send parcels.

Messages in, messages out: it has no clock, no link and no thread, apart from its members' own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

from minerva_bus.errors import ProtocolError, SceneError, WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import ORDERS
from minerva_bus.frame.inbox import MAX_WAITING
from minerva_bus.frame.member import Member, Outgoing, WorldRestarted
from minerva_bus.frame.norms import NORMS
from minerva_bus.frame.own_agents import OwnAgents
from minerva_bus.frame.phases import Phase
from minerva_bus.launch.failures import own_members
from minerva_bus.launch.free_running import close_services
from minerva_bus.launch.in_process import members_of
from minerva_bus.launch.regions.checkpoint import RegionCheckpoint
from minerva_bus.launch.regions.journal import MAX_BYTES
from minerva_bus.launch.regions.layout import RegionSpec
from minerva_bus.launch.regions.past import RegionPast
from minerva_bus.launch.regions.requests import RegionRequests
from minerva_bus.launch.regions.runner import MakeRunner, RegionRunner
from minerva_bus.launch.regions.sending import ParcelSender
from minerva_bus.launch.regions.terms import agreed
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.log.entries import encode_inputs
from minerva_bus.regions.generated import packed_answers, reported
from minerva_bus.regions.hosts import host_figures
from minerva_bus.regions.journal import CHECKPOINT, COORDINATOR, JOURNAL
from minerva_bus.regions.judging import LINES
from minerva_bus.regions.merging import Units, agents_in
from minerva_bus.regions.messages import (
    AgainMessage,
    expected_sources,
    from_message,
    to_message,
)
from minerva_bus.regions.norms import violations
from minerva_bus.regions.part import PartMessage
from minerva_bus.regions.partition import Partition
from minerva_bus.regions.region import Region
from minerva_bus.regions.whole import FIRST, PART
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.region_links import ParcelArrived
from minerva_bus.runtime.runner import Notice
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.keys import COORDINATOR as HUB
from minerva_bus.wire.limits import ON_DISK


class RegionMember(Member):
    """One region of a world, with members for its agents and generators in this process.

    `send` sends a parcel to another region; it may be lost, because parcels are kept until they are
    acknowledged. `log` is called with the name of a member, or "", a text about it, and details.
    With another runner than the default, agents may have hosts elsewhere: `hosts_answered`
    continues what waits for them.
    """

    def __init__(
        self,
        spec: RegionSpec,
        send: Callable[[int, bytes], None],
        log: Callable[[str, str, str], None],
        make_runner: MakeRunner = InProcessRunner,
    ) -> None:
        super().__init__(spec.name)
        file = spec.world_file
        assert file.partition is not None
        self._make_runner = make_runner
        self._parcels = ParcelSender(send)
        self._file = file
        self._members = members_of(file)
        self._requests = RegionRequests(spec.ahead)
        self._begin(self._region(file, spec.number, file.partition))
        self._decoder = Decoder(file.world.vocabulary, file.access.limits)
        self._journal = spec.make_journal()
        self._log = log
        self._done: s.FrameDone | None = None
        self._ending = ""
        self._past: RegionPast | None = RegionPast()
        self._handlers[m.RegionRequest] = self._on_request

    def _region(self, file: WorldFile, number: int, partition: Partition) -> Region:
        return Region(file.world, number, partition, self._members, ahead=self._requests.ahead)

    def _begin(self, region: Region) -> None:
        self.region = region
        region.services.send = self._parcels.send
        self._runner: RegionRunner = self._make_runner(
            region.algorithm, self._members, self._observe, deliver=region.services.deliver
        )
        # The coordinator has limited the events of each generator.
        region.algorithm.inbox.max_single_events = MAX_WAITING

    @property
    def running(self) -> str:
        """The name of the member whose code runs, or has failed; "" if none does."""
        return self.region.services.running

    def hello(self) -> m.Hello:
        """A member in step that generates nothing itself."""
        service = f"region {self.region.number}"
        return replace(super().hello(), service=service, lockstep=True)

    # --- messages ---

    def _on_welcome(self, welcome: m.Welcome) -> None:
        if self.stopped:  # It was on its way when the world ended.
            return
        joins, saved = self.world is None, welcome.saved or {}
        region, ahead = self.region, self._requests.ahead
        file, present = agreed(self._file, self.name, ahead, saved), welcome.frame + 1 + ahead
        if not joins and (file is not self._file or present < region.frame):
            raise WorldRestarted(f"the world has restarted, at frame {welcome.frame}")
        if file is not self._file:
            self._file = file
            self._begin(self._region(file, region.number, region.partition))
        super()._on_welcome(welcome)
        if not joins:
            return
        self._journal.continue_from(saved.get(JOURNAL))
        self._past = self._journaled(welcome.frame)
        self._out.extend(self.hosts_answered())

    @own_members()
    def _journaled(self, frame: int) -> RegionPast:
        """The frames of the process before this one, up to the one that the world is in."""
        if frame > self.region.frame and not self._journal.exists:
            lost = f"its journal was longer than {MAX_BYTES >> 20} MiB"
            raise WorldStopped(f"a new process cannot repeat {frame} frames: {lost}")
        self._parcels.repeats = True
        entries = self._journal.read()
        first = next(entries, None)
        if first is not None and first.source == CHECKPOINT:
            self._restore(RegionCheckpoint.decoded(first.data))
        self._runner.start()
        entries = iter(()) if first is None else chain([first], entries)
        return RegionPast(entries, [] if self._past is None else self._past.early)

    def _repeat(self, past: Iterator[ParcelArrived]) -> bool:
        """Run the frames of the process before this one again; others have what it sent.

        Returns False if hosts have to answer first.
        """
        # One by one, because the report of a repeated frame has the entries up to it.
        for _ in self._advance():
            pass
        while not self._is_busy and (entry := next(past, None)) is not None:
            if entry.source == COORDINATOR:
                self._note(self._decoder.to_member(entry.data))
            elif entry.source != CHECKPOINT:
                self._accept(entry)
            for _ in self._advance():
                pass
        return not self._is_busy

    def hosts_answered(self) -> list[Outgoing]:
        """Continue what waits for hosts elsewhere; returns the messages to the coordinator.

        Raises WorldStopped if what others have sent is invalid.
        """
        out: list[Outgoing] = []
        past = self._past
        if past is not None and past.entries is not None and not self._ending:
            if not self._repeat(past.entries):
                return out
            self._past, self._parcels.repeats = None, False
            self._journal.open()
            for arrived in past.early:
                if isinstance(arrived, ParcelArrived):
                    out += self.parcel(arrived)
                else:
                    out += self._requested(arrived)
            self.send_again(range(self.region.partition.count))
        return [*out, *self._advance(), *self._last_report()]

    @property
    def _is_busy(self) -> bool:
        """Whether a frame is in progress, or the first one waits for hosts."""
        return self.region.algorithm.phase is not Phase.READY

    # --- checkpoints ---

    def _save(self) -> None:
        """Replace the journal by the state of the region before the frame that begins."""
        region, count = self.region, self.region.partition.count
        kept = [each for other in range(count) for each in self._parcels.outbox.kept_for(other)]
        messages = [
            [[each.target, encode(to_message(each))] for each in kept],
            [[each.source, encode(to_message(each))] for each in region.arrived],
            [encode(report) for _, report in sorted(self._requests.reports.items())],
            [encode(request) for request in self._requests.waiting],
            self._parcels.sent_bytes,
        ]
        self._journal.begin_again(RegionCheckpoint.of(region, messages).encoded())

    def _restore(self, checkpoint: RegionCheckpoint) -> None:
        """Continue from the state that a former process of this region has saved."""
        number, partition = self.region.number, self.region.partition
        world, members = self._file.world, self._members
        self._begin(checkpoint.region(world, number, partition, members, self._requests.ahead))
        kept, arrived, reports, requests, sent_bytes = checkpoint.messages
        decoder = Decoder(self._file.world.vocabulary, ON_DISK)
        self._parcels.sent_bytes = sent_bytes
        for target, data in kept:
            parcel = from_message(decoder.parcel(data), number, target)
            self._parcels.outbox.keep([parcel])
        for source, data in arrived:
            self._accept(ParcelArrived(source, data))
        for data in reports:
            report = decoder.from_member(self.name, data)
            assert isinstance(report, m.TickReply)
            self._requests.reports[report.frame] = report
        for data in requests:
            self._note(self._decoder.to_member(data))

    # --- arrivals ---

    def parcel(self, arrived: ParcelArrived) -> list[Outgoing]:
        """Accept a parcel of another region; returns the messages to the coordinator.

        Raises WorldStopped if it is invalid.
        """
        if self._past is not None:
            self._past.early.append(arrived)
            return []
        if self._accept(arrived):
            # Before the next parcel of this region acknowledges it.
            self._journal.write(arrived)
        return list(self._advance())

    def send_again(self, regions: Iterable[int]) -> None:
        """Send what these regions may not have."""
        self._parcels.again(regions)

    def a_second_later(self) -> None:
        """Request what may have been lost. Raises WorldStopped if a region sends nothing valid.

        Called once a second.
        """
        self._parcels.a_second_later(self.awaited, self.region.frame)

    @property
    def awaited(self) -> list[int]:
        """The regions whose messages a requested frame needs."""
        return [] if self._requests.of(self.region.frame) is None else self.region.missing

    def _accept(self, arrived: ParcelArrived) -> bool:
        try:
            message = self._decoder.parcel(arrived.data, self._known_agents())
            if isinstance(message, AgainMessage):
                self._parcels.again([arrived.source], self._needed_for(message.frame))
                return False
            received = from_message(message, arrived.source, self.region.number)
            is_new = self.region.receive(received)
        except (ProtocolError, SceneError) as error:
            text = f"region {arrived.source} has sent an invalid parcel: {error}"
            raise WorldStopped(text) from None
        since = self._needed_for(self.region.frame)
        self._parcels.received(received, is_new=is_new, since=since)
        return is_new

    def _needed_for(self, frame: int) -> int:
        """The first frame whose parcels may be needed for a frame."""
        return frame - 1 - self._requests.ahead

    def _known_agents(self) -> OwnAgents:
        """The agents of the first string and of this region: as many may move here at once."""
        return agents_in([Units((), self._file.world.scene.pieces), self.region.units])

    def _on_request(self, request: m.RegionRequest) -> None:
        self._out.extend(self._requested(request))

    def _requested(self, request: m.RegionRequest) -> list[m.TickReply]:
        """The reports after the request of a frame."""
        if self._past is not None:
            self._past.early.append(request)
            return []
        if request.frame in self._requests.reports:
            return [self._requests.reports[request.frame], *self._advance()]
        if request.frame > self._requests.last:
            self._journal.write(ParcelArrived(COORDINATOR, encode(request)))
            self._note(request)
        return [*self._advance()]

    def _note(self, request: m.ToMember) -> None:
        assert isinstance(request, m.RegionRequest)
        self._requests.note(request)
        # What the requests ahead of the last complete frame do not need any more, others may.
        self._parcels.outbox.acknowledge(request.frame - 2 * self._requests.ahead)

    def _on_stop(self, stop: m.Stop) -> None:
        # A successor of the coordinator may ask again.
        self._ending, self.stopped = stop.reason or "the world has ended", ""
        self.region.end()
        self._runner.handle(s.End(stop.reason))
        self._out.extend(self._last_report())

    def _last_report(self) -> list[m.Report]:
        """The report to the coordinator, once all members have reported after the end."""
        if not self._ending or self.stopped or self._runner.ended is None:
            return []
        self.stopped = self._ending
        elsewhere = self.region.services.elsewhere
        members = (each for each in self._members if not elsewhere(each))
        close_services(members, lambda name, text: self._log(name, text, ""))
        return [m.Report(self.name, self._last_figures())]

    def figures(self) -> m.Figures:
        """Before the end of the world only its hosts."""
        return host_figures(self.region.algorithm.members, [each.name for each in self._members])

    def _last_figures(self) -> m.Figures:
        count, frames, ended = self.region.partition.count, self.region.frame, self._runner.ended
        figures, sent = dict[str, int](), frames * count * (count - 1)
        if sent:  # The coordinator adds them up to the mean over all regions.
            figures["parcel_bytes"] = round(self._parcels.sent_bytes / sent)
        # The members of one region report the figures of all, because generators are equal, and
        # the coordinator those of norms.
        if self.region.number != FIRST:
            return {**figures, **self.region.services.nearby.figures()}
        if ended is None:
            return figures
        broken = violations(ended.figures)
        members = {name: value for name, value in ended.figures.items() if name not in broken}
        return {"regions": count, **figures, **members}

    # --- frames ---

    def _advance(self) -> Iterator[m.TickReply]:
        """Run the requested frames for which everything has arrived.

        The last one may go on when hosts elsewhere have answered.
        """
        region = self.region
        if self._done is not None:
            yield self._end_frame(self._done)
        while not self._is_busy and (request := self._requests.of(region.frame)) is not None:
            region.expect(expected_sources(region.schedule, request, region.number))
            if region.missing:
                return
            try:
                region.enter()
            except ProtocolError as error:
                raise WorldStopped(f"region {region.number}: {error}") from None
            # Services in another region may still have to answer for this frame.
            if region.missing:
                return
            if self._journal.is_due():
                self._save()
            self._begin_frame()
            if self._done is not None:
                yield self._end_frame(self._done)

    @own_members()
    def _begin_frame(self) -> None:
        region, self.frame = self.region, self.region.frame
        self._parcels.frame_begun()
        region.give(self._requests.take(self.frame))
        self._runner.handle(s.Begin())

    def _end_frame(self, done: s.FrameDone) -> m.TickReply:
        region, self._done = self.region, None
        # Parcels lead to the state of the next frame, and the report is of this one.
        state, norms = (region.units, region.sent, region.progress()), region.norm_report
        parcels = [parcel for parcel in region.leave() if not region.keeps(parcel)]
        self._parcels.send(parcels)
        targets = [parcel.target for parcel in parcels]
        answered = packed_answers(region.services.nearby.answered)
        message = partial(
            self._requests.sender.message,
            self.frame,
            *state,
            targets,
            norms=norms,
            answered=answered,
        )
        report = self._report(message, done)
        self._requests.keep(report)
        return report

    def _report(self, message: Callable[[bytes], PartMessage], done: s.FrameDone) -> m.TickReply:
        answered, first = self.region.services.nearby.answered, self.region.number == FIRST
        inputs = reported(done.inputs, answered, first=first)
        entry = b"" if inputs is None else encode_inputs(inputs)
        saved: dict[str, Any] = {
            PART: encode(message(entry)),
            JOURNAL: self._journal.unreported(),
        }
        if lines := self._requests.take_lines():
            saved[LINES] = lines
        return m.TickReply(self.name, self.frame, (), saved)

    def _observe(self, notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            self._done = notice
        elif isinstance(notice, s.Notify) and notice.member == NORMS:
            self._requests.lines.append(notice.text)  # A line of the whole world.
        elif isinstance(notice, s.Notify) and notice.member != ORDERS:  # The coordinator logs it.
            about = "" if notice.member == HUB else notice.member
            self._log(about, notice.text, notice.details)
        elif isinstance(notice, s.Stopping) and self.region.algorithm.failed:
            # A region's algorithm ends by itself only because of a failure.
            raise WorldStopped(notice.reason)
