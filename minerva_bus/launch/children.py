"""What runs in the launcher's children: a member, or the coordinator with its reports."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

from minerva_bus.bus.coordinator import BusCoordinator, Patience, Printed, Status, Watchers
from minerva_bus.bus.member import BusMember
from minerva_bus.frame import stimuli as s
from minerva_bus.launch.profiling import profile_of, sampled
from minerva_bus.launch.recording import Nothing, Recording, recording
from minerva_bus.launch.reports import Lines, Reports
from minerva_bus.launch.worldfile import Process, WorldFile


def take_part(process: Process, world: str, endpoint: str, sample: bool, shared: bool) -> int:
    """Be a member of a world; the exit code."""

    def tell(line: str) -> None:
        print(line, flush=True)  # noqa: T201

    member = BusMember(process.participant(), world, endpoint, tell, shared=shared)
    return sampled(member.run, profile_of(world, process.name)) if sample else member.run()


def coordinate(
    file: WorldFile,
    reports: Reports,
    commands: int,
    profile: bool,
    shared: bool,
    make: Callable[..., BusCoordinator],
) -> int:
    """Be a world's coordinator, which reports to the launcher and obeys it; the exit code."""
    told = _Told(reports)
    coordinator = make(
        file.world,
        told.watchers(),
        rate=file.rate,
        listen=file.bus.listen,
        patience=Patience(file.bus.soft, file.bus.hard),
        shared=shared,
        keep=profile,
    )
    told.coordinator = coordinator
    told.record = recording(
        file, coordinator.algorithm, lambda text: reports.tell("said", member="record", text=text)
    )
    threading.Thread(target=_obey, args=(commands, coordinator), daemon=True).start()
    try:
        ended = coordinator.run()
    finally:
        told.record.close()
    told.ended(ended)
    return 0


class _Told:
    """What the launcher is told, and the record, of a world that runs."""

    coordinator: BusCoordinator

    def __init__(self, reports: Reports) -> None:
        self.record: Recording = Nothing()
        self._reports = reports
        self._began: float | None = None
        self._members = 0

    def watchers(self) -> Watchers:
        """Those who tell it."""
        tell = self._reports.tell
        return Watchers(
            said=self._said,
            status=self._status,
            listening=lambda endpoint: tell("listening", endpoint=endpoint),
            stalled=lambda member, waited: tell("stalled", member=member, waited=waited),
            frame_done=self._frame_done,
            stopping=lambda: tell("stopping"),
            restart=lambda member: tell("restart", member=member) or "",
        )

    def _frame_done(self, done: s.FrameDone) -> None:
        self.record.frame(done)
        if self._began is None:
            self._began = time.monotonic()
            self._members = len(self.coordinator.algorithm.roster.here())
            self._reports.tell("first_frame")

    def _said(self, member: str, text: str) -> None:
        self.record.said(member, text)
        self._reports.tell("said", member=member, text=text)

    def _status(self, now: Status) -> None:
        self._reports.tell(
            "status", frame=now.frame, rate=now.rate, members=now.members, phase=now.phase,
            paused=now.paused, waiting=now.waiting, waited=now.waited,
        )  # fmt: skip

    def ended(self, ended: s.Ended) -> None:
        """The world is over."""
        coordinator, algorithm = self.coordinator, self.coordinator.algorithm
        self._reports.tell(
            "ended",
            reason=ended.reason,
            failed=algorithm.failed,
            frames=algorithm.frame,
            digest=algorithm.scene.digest.hex(),
            reached=algorithm.reached,
            seconds=0.0 if self._began is None else coordinator.last_frame_at - self._began,
            members=max(self._members, coordinator.most_members),
            figures=dict(ended.figures),
            profile=coordinator.profile(),
        )


def _obey(commands: int, coordinator: BusCoordinator) -> None:
    lines = Lines()
    while data := os.read(commands, 4096):
        for line in lines.feed(data):
            word, _, rest = line.partition(" ")
            if word == "log":
                member, _, text = rest.partition(" ")
                coordinator.inbox.put(Printed(member, text))
            elif word == "gave_up":
                coordinator.inbox.put(s.GaveUp(rest))
            elif word == "stop":
                coordinator.inbox.put(s.End("interrupted"))
