"""A region as a member of its world: the coordinator requests frames, regions send parcels.

Messages in, messages out: it has no clock, no link and no thread, apart from its members' own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Final

from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member, Outgoing, WorldRestarted
from minerva_bus.launch.regions.frames import RegionFrames
from minerva_bus.launch.regions.layout import RegionSpec
from minerva_bus.launch.regions.past import RegionPast
from minerva_bus.launch.regions.runner import MakeRunner
from minerva_bus.launch.regions.terms import agreed
from minerva_bus.regions.journal import COORDINATOR, JOURNAL, PROCESS
from minerva_bus.regions.region import Region
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.region_links import ParcelArrived
from minerva_bus.wire.codec import encode
from minerva_bus.wire.keys import name_of_region

PATIENCE: Final = 5
"""Seconds for which services of a region wait for views if a person ends the world.

A region that has ended before does not send a lost parcel again, and a person may end a world
because a link is cut. When a world is over, the coordinator waits until services have seen them.
"""


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
        self._log = log
        self._frames = RegionFrames(spec, send, log, self._begins, make_runner)
        self._past: RegionPast | None = RegionPast(self._frames)
        self._ending = ""
        self._patience = PATIENCE
        self._handlers[m.RegionRequest] = self._on_request

    def _begins(self, frame: int) -> None:
        self.frame = frame

    @property
    def region(self) -> Region:
        """The region in its present frame."""
        return self._frames.region

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
        joins, saved, frames = self.world is None, welcome.saved or {}, self._frames
        if self.stopped:  # It was on its way when the world ended, or a successor ends it again.
            frames.requests.process = saved.get(PROCESS, 0)
            return
        ahead = frames.requests.ahead
        file, present = agreed(frames.file, self.name, ahead, saved), welcome.frame + 1 + ahead
        if not joins and (file is not frames.file or present < frames.region.frame):
            raise WorldRestarted(f"the world has restarted, at frame {welcome.frame}")
        if file is not frames.file:
            frames.adopt(file)
        super()._on_welcome(welcome)
        frames.requests.process = saved.get(PROCESS, 0)
        if not joins:
            return
        frames.journal.continue_from(saved.get(JOURNAL))
        assert self._past is not None
        self._past.begin(welcome.frame)
        self._out.extend(self.hosts_answered())

    def hosts_answered(self) -> list[Outgoing]:
        """Continue what waits for hosts elsewhere; returns the messages to the coordinator.

        Raises WorldStopped if what others have sent is invalid.
        """
        out: list[Outgoing] = []
        past = self._past
        if past is not None and past.has_begun and not self._ending:
            if not past.repeat():
                return out
            self._past = None
            for arrived in past.early:
                if isinstance(arrived, ParcelArrived):
                    out += self.parcel(arrived)
                else:
                    out += self._requested(arrived)
            self.send_again(range(self.region.partition.count))
        return [*out, *self._frames_run()]

    # --- arrivals ---

    def parcel(self, arrived: ParcelArrived) -> list[Outgoing]:
        """Accept a parcel of another region; returns the messages to the coordinator.

        Raises WorldStopped if it is invalid.
        """
        if self._past is not None:
            self._past.early.append(arrived)
            return []
        if self._frames.accept(arrived):
            # Before the next parcel of this region acknowledges it.
            self._frames.journal.write(arrived)
        return self._frames_run()

    def send_again(self, regions: Iterable[int]) -> None:
        """Send what these regions may not have."""
        self._frames.parcels.again(regions)

    def a_second_later(self) -> list[Outgoing]:
        """Request what may have been lost; returns the messages to the coordinator.

        Called once a second. Raises WorldStopped if a region sends nothing valid.
        """
        self._frames.parcels.a_second_later(self.awaited, self.region.frame)
        self._patience -= bool(self._ending)
        return self._last_report() if self._ending else []

    @property
    def awaited(self) -> list[int]:
        """The regions whose messages a requested frame needs."""
        return self._frames.awaited

    def _frames_run(self) -> list[Outgoing]:
        """Run what can run now, or end; returns the messages to the coordinator."""
        return self._last_report() if self._ending else [*self._frames.advance()]

    def _on_request(self, request: m.RegionRequest) -> None:
        self._out.extend(self._requested(request))

    def _requested(self, request: m.RegionRequest) -> list[m.TickReply]:
        """The reports after the request of a frame."""
        if self._past is not None:
            self._past.early.append(request)
            return []
        if (report := self._frames.requests.report(request.frame)) is not None:
            return [report, *self._frames.advance()]
        # A request to this region may arrive after a later one to all regions.
        if self._frames.is_new(request):
            if not request.last:  # The coordinator repeats it to another process.
                self._frames.journal.write(ParcelArrived(COORDINATOR, encode(request)))
            self._frames.note(request)
        return [*self._frames.advance()]

    def _on_stop(self, stop: m.Stop) -> None:
        # A successor of the coordinator may ask again.
        self._ending, self.stopped = stop.reason or "the world has ended", ""
        self._out.extend(self._last_report())

    def _last_report(self) -> list[Outgoing]:
        """The report to the coordinator, once all members have reported after the end."""
        frames = self._frames
        if self.stopped:
            return []
        if not frames.is_ending:
            if self._past is None and not frames.see():
                if self._patience > 0:
                    return []
                self._report_unseen()
            frames.end(self._ending)
        if not frames.has_ended:
            return []
        self.stopped = self._ending
        self._frames.close()
        return [m.Report(self.name, self._frames.last_figures())]

    def _report_unseen(self) -> None:
        awaited = ", ".join(map(name_of_region, self.awaited))
        text = f"its services have not seen the last views: nothing has arrived from {awaited}"
        self._log("", f"{self.name}: {text} for {PATIENCE} s", "")

    def figures(self) -> m.Figures:
        """Before the end of the world only its hosts."""
        return self._frames.figures()
