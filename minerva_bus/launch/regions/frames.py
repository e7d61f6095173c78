"""The frames of a region whose members are in this process, or on hosts elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from minerva_bus.errors import ProtocolError, SceneError, WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import ORDERS
from minerva_bus.frame.inbox import MAX_WAITING
from minerva_bus.frame.norms import NORMS
from minerva_bus.frame.own_agents import OwnAgents
from minerva_bus.frame.phases import Phase
from minerva_bus.launch.failures import own_members
from minerva_bus.launch.free_running import close_services
from minerva_bus.launch.in_process_parts import members_of
from minerva_bus.launch.regions.checkpoint import RegionCheckpoint
from minerva_bus.launch.regions.for_all import needed_by_all, packed_for_all
from minerva_bus.launch.regions.layout import RegionSpec
from minerva_bus.launch.regions.requests import RegionRequests
from minerva_bus.launch.regions.runner import MakeRunner, RegionRunner
from minerva_bus.launch.regions.sending import ParcelSender
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.log.entries import encode_inputs
from minerva_bus.regions.generated import packed_answers, reported
from minerva_bus.regions.hosts import agents_of_hosts, host_figures
from minerva_bus.regions.journal import JOURNAL
from minerva_bus.regions.judging import LINES
from minerva_bus.regions.merging import PlacedEvent, Units, agents_in
from minerva_bus.regions.messages import AgainMessage, expected_sources, from_message
from minerva_bus.regions.norms import violations
from minerva_bus.regions.part import PartMessage
from minerva_bus.regions.region import Region
from minerva_bus.regions.whole import FIRST, PART
from minerva_bus.runtime.region_links import ParcelArrived
from minerva_bus.runtime.runner import Notice
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.keys import COORDINATOR as HUB


class RegionFrames:
    """Runs the requested frames of a region, and keeps what another process needs to repeat them.

    `send` sends a parcel to another region. `log` is called with the name of a member, or "", a
    text about it, and details; `begins` with the number of each frame that begins. `journal` has
    what has arrived. `is_ending`: the members have to report.
    """

    def __init__(
        self,
        spec: RegionSpec,
        send: Callable[[int, bytes], None],
        log: Callable[[str, str, str], None],
        begins: Callable[[int], None],
        make_runner: MakeRunner,
    ) -> None:
        file = spec.world_file
        assert file.partition is not None
        self.name = spec.name
        self.file = file
        self.members = members_of(file)
        self.requests = RegionRequests(spec.ahead)
        self.parcels = ParcelSender(send)
        self.journal = spec.make_journal()
        self._log = log
        self._begins = begins
        self._make_runner = make_runner
        self._done: s.FrameDone | None = None
        self.is_ending = False
        self._reported = -1
        self._begin(Region(file.world, spec.number, file.partition, self.members, ahead=spec.ahead))
        self.decoder = Decoder(file.world.vocabulary, file.access.limits)

    def _begin(self, region: Region) -> None:
        self.region = region
        region.services.send = self.parcels.send
        self._runner: RegionRunner = self._make_runner(
            region.algorithm, self.members, self._observe, deliver=region.services.deliver
        )
        # The coordinator has limited the events of each generator.
        region.algorithm.inbox.max_single_events = MAX_WAITING

    def adopt(self, file: WorldFile) -> None:
        """Begin with another world file, which has settings of the coordinator's."""
        self.file, region = file, self.region
        ahead = self.requests.ahead
        self._begin(Region(file.world, region.number, region.partition, self.members, ahead=ahead))

    def restore(self, checkpoint: RegionCheckpoint) -> None:
        """Begin with the state that a former process of this region has saved."""
        number, partition = self.region.number, self.region.partition
        world, ahead = self.file.world, self.requests.ahead
        self._begin(checkpoint.region(world, number, partition, self.members, ahead))

    def start(self) -> None:
        """Let the members join. Raises WorldStopped if one cannot."""
        self._runner.start()

    def see(self) -> bool:
        """Let services see the views of the last frame; False if something with them is missing.

        The request for the frame after it tells which parcels there are.
        """
        request = self.requests.of(self.region.frame)
        if self.is_busy or request is None or not self.region.services.see:
            return True
        return self._enter(request, last=True)

    def end(self, reason: str) -> None:
        """End the world before the next frame."""
        self.is_ending = True
        self.region.end()
        self._runner.handle(s.End(reason))

    @property
    def has_ended(self) -> bool:
        """Whether all members have reported after the end."""
        return self._runner.ended is not None

    def close(self) -> None:
        """Close the services in this process."""
        elsewhere = self.region.services.elsewhere
        members = (each for each in self.members if not elsewhere(each))
        close_services(members, lambda name, text: self._log(name, text, ""))

    @property
    def is_busy(self) -> bool:
        """Whether a frame is in progress, or the first one waits for hosts."""
        return self.region.algorithm.phase is not Phase.READY

    # --- arrivals ---

    @property
    def awaited(self) -> list[int]:
        """The regions whose messages a requested frame needs."""
        return [] if self.requests.of(self.region.frame) is None else self.region.missing

    def accept(self, arrived: ParcelArrived) -> bool:
        """Accept a parcel of another region; returns False if it has arrived before.

        Raises WorldStopped if it is invalid.
        """
        try:
            message = self.decoder.parcel(arrived.data, self._known_agents())
            if isinstance(message, AgainMessage):
                self.parcels.again([arrived.source], self._needed_for(message.frame))
                return False
            received = from_message(message, arrived.source, self.region.number)
            is_new = self.region.receive(received)
        except (ProtocolError, SceneError) as error:
            text = f"region {arrived.source} has sent an invalid parcel: {error}"
            raise WorldStopped(text) from None
        since = self._needed_for(self.region.frame)
        self.parcels.received(received, is_new=is_new, since=since)
        return is_new

    def _needed_for(self, frame: int) -> int:
        """The first frame whose parcels may be needed for a frame."""
        return frame - 1 - self.requests.ahead

    def _known_agents(self) -> OwnAgents:
        """The agents of the first string and of this region: as many may move here at once."""
        first, region = self.file.world.scene.pieces, self.region
        return agents_in(lambda: [Units((), first), region.units])

    def _needed_by_all(self, request: m.RegionRequest) -> Sequence[PlacedEvent]:
        return needed_by_all(self.decoder, request, self._known_agents())

    def is_new(self, request: m.RegionRequest) -> bool:
        """Whether a request is for a frame that has not begun, and has not been noted."""
        begun = self.region.frame + self.is_busy
        return request.frame >= begun and self.requests.of(request.frame) is None

    def note(self, request: m.RegionRequest) -> None:
        """Accept the request of a frame."""
        self.requests.note(request)
        # What the requests ahead of the last complete frame do not need any more, others may; and
        # a successor repeats the frame of the last views.
        self.parcels.outbox.acknowledge(request.frame - 2 * self.requests.ahead - request.last)

    # --- frames ---

    def advance(self) -> Iterator[m.TickReply]:
        """Run the requested frames for which everything has arrived.

        The last one may go on when hosts elsewhere have answered.
        """
        region = self.region
        if self._done is not None:
            yield self._end_frame(self._done)
        while not self.is_busy and (request := self.requests.of(region.frame)) is not None:
            if not self._enter(request, last=request.last or request.views):
                return
            if request.last:
                yield from self.requests.seen(self.name, request)
                return
            if not request.views and self.journal.is_due():
                checkpoint = RegionCheckpoint.at(region, self.parcels, self.requests)
                self.journal.begin_again(checkpoint.encoded())
            self._begin_frame()
            if self._done is not None:
                yield self._end_frame(self._done)

    def _enter(self, request: m.RegionRequest, *, last: bool) -> bool:
        """Enter a requested frame; False if something that it needs has not arrived."""
        region = self.region
        region.expect(expected_sources(region.schedule, request, region.number))
        if region.missing:
            return False
        try:
            region.enter(partial(self._needed_by_all, request), last=last)
        except ProtocolError as error:
            raise WorldStopped(f"region {region.number}: {error}") from None
        # Services in another region may still have to answer for this frame.
        if region.missing:
            return False
        if last:
            region.settle()
        return True

    @own_members()
    def _begin_frame(self) -> None:
        region, frame = self.region, self.region.frame
        self._begins(frame)
        self.parcels.frame_begun()
        region.give(self.requests.take(frame), again=self.parcels.repeats)
        self._runner.handle(s.Begin())

    def _end_frame(self, done: s.FrameDone) -> m.TickReply:
        region, self._done = self.region, None
        # Parcels lead to the state of the next frame, and the report is of this one.
        state, norms = (region.units, region.sent, region.progress()), region.norm_report
        parcels = [parcel for parcel in region.leave() if not region.keeps(parcel)]
        self.parcels.send(parcels)
        targets = [parcel.target for parcel in parcels]
        answered = packed_answers(region.services.nearby.answered)
        message = partial(
            self.requests.sender.message,
            done.frame,
            *state,
            targets,
            norms=norms,
            answered=answered,
            for_all=packed_for_all(region),
        )
        return self.requests.keep(self._report(message, done))

    def _report(self, message: Callable[[bytes], PartMessage], done: s.FrameDone) -> m.TickReply:
        answered, first = self.region.services.nearby.answered, self.region.number == FIRST
        inputs = reported(done.inputs, answered, first=first)
        entry = b"" if inputs is None else encode_inputs(inputs)
        saved: dict[str, Any] = {PART: encode(message(entry)), JOURNAL: self.journal.unreported()}
        if lines := self.requests.take_lines():
            saved[LINES] = lines
        return m.TickReply(self.name, done.frame, (), saved)

    def _observe(self, notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            self._done = notice
        elif isinstance(notice, s.Notify) and notice.member == NORMS:
            self.requests.lines.append(notice.text)  # A line of the whole world.
        elif isinstance(notice, s.Notify) and notice.member != ORDERS:  # The coordinator logs it.
            about = "" if notice.member == HUB else notice.member
            self._log(about, notice.text, notice.details)
        elif isinstance(notice, s.Stopping) and self.region.algorithm.failed:
            # A region's algorithm ends by itself only because of a failure.
            raise WorldStopped(notice.reason)

    # --- figures ---

    def figures(self) -> m.Figures:
        """Before the end of the world: only about hosts."""
        algorithm, own = self.region.algorithm, [each.name for each in self.members]
        # A frame that is under way in two reports has been waiting for a second.
        waits = algorithm.phase is not Phase.READY and algorithm.frame == self._reported
        self._reported = algorithm.frame
        waiting = algorithm.waiting_for() if waits else ()
        outlooks = {name: self._runner.outlook(name) for name in waiting}
        has_hosts = any(member.name not in own for member in algorithm.members)
        agents = agents_of_hosts(algorithm) if has_hosts else None
        return host_figures(algorithm.members, own, self.name, outlooks, agents)

    def last_figures(self) -> m.Figures:
        """After the end of the world."""
        count, frames, ended = self.region.partition.count, self.region.frame, self._runner.ended
        figures, sent = dict[str, int](), frames * count * (count - 1)
        if sent:  # The coordinator adds them up to the mean over all regions.
            figures["parcel_bytes"] = round(self.parcels.sent_bytes / sent)
        # The members of one region report the figures of all, because generators are equal, and
        # the coordinator those of norms.
        if self.region.number != FIRST:
            return {**figures, **self.region.services.nearby.figures()}
        if ended is None:
            return figures
        broken = violations(ended.figures)
        members = {name: value for name, value in ended.figures.items() if name not in broken}
        return {"regions": count, **figures, **members}
