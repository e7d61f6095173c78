"""What runs in the launcher's children: a member, or the coordinator with its reports."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Collection, Generator
from dataclasses import dataclass
from typing import Any

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.launch.access import security
from minerva_bus.launch.collecting import CollectSink, collect_sink
from minerva_bus.launch.exporting import exported
from minerva_bus.launch.journaling import RunJournal, find_past, next_epoch
from minerva_bus.launch.profiling import Profiling, profile_of, sampled
from minerva_bus.launch.recording import RunRecord, recording
from minerva_bus.launch.reports import Lines, Reports
from minerva_bus.launch.sizes import check_sizes
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.log.journal import resume_from
from minerva_bus.runtime.admission import ListenConfig
from minerva_bus.runtime.arrival import STARTED_HERE
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.member import MemberProcess
from minerva_bus.runtime.overhearing import overhear
from minerva_bus.runtime.status import Status
from minerva_bus.runtime.system import REAL, System, run_through
from minerva_bus.runtime.watchers import Printed, Started, Watchers


@dataclass(frozen=True, slots=True)
class Coordinating:
    """A coordinator to be started: of which world, made by what, and whether it goes on.

    `queued` are the members yet to be started.
    """

    file: WorldFile
    make: Callable[..., Coordinator]
    profile: bool
    shared: bool
    again: bool
    queued: frozenset[str]


@dataclass(frozen=True, slots=True)
class Joining:
    """A member to be started: which process, and where its world is."""

    process: Process
    world: str
    endpoint: str
    shared: bool
    profiling: Profiling


def take_part(work: Joining) -> int:
    """Be a member of a world; the exit code."""
    process, world = work.process, work.world

    def tell(line: str) -> None:
        print(line, flush=True)  # noqa: T201

    member = MemberProcess(
        process.participant(), world, work.endpoint, tell, shared=work.shared, arrival=STARTED_HERE
    )
    sample = process.name == work.profiling.member
    return sampled(member.run, profile_of(world, process.name)) if sample else member.run()


def coordinate(work: Coordinating, reports: Reports, commands: int) -> int:
    """Be a world's coordinator, which reports to the launcher and obeys it; the exit code."""
    shift = Shift(work, reports)
    threading.Thread(target=_obey, args=(commands, shift.coordinator), daemon=True).start()
    name, listen, ask = work.file.world.name, work.file.watch.metrics, shift.coordinator.ask
    with exported(name, listen, ask, lambda text: reports.tell("noted", text=text)):
        return run_through(shift.life())


class Shift:
    """One coordinator's share of a run, from where the one before it ended."""

    def __init__(self, work: Coordinating, reports: Reports, system: System = REAL) -> None:
        """Raises RecordError and BusError where it cannot begin."""
        file, again = work.file, work.again
        started = [one.name for one in file.processes if not one.elsewhere]
        told = self._told = _Told(reports, [one.name for one in file.processes if one.elsewhere])
        past = find_past(file, again=again)
        algorithm = FrameAlgorithm(file.world if past is None else past.world)
        check_sizes(algorithm.composition.fragments, file.processes)

        def say(text: str) -> None:
            reports.tell("said", member="record", text=text)

        told.record = recording(file, algorithm, say, again=past is not None)
        if past is not None:
            resume_from(past, algorithm, told.record.frame)
            lost = f"; {past.lost:,} bytes behind it cannot be read" if past.lost else ""
            reports.tell("noted", text=f"goes on from frame {algorithm.frame} of its journal{lost}")

        def note(text: str) -> None:
            reports.tell("noted", text=text)

        told.collected = collect_sink(file.collect, algorithm, note, again=past is not None)
        self.coordinator = told.coordinator = work.make(
            file.world,
            told.watchers(),
            rate=file.rate,
            where=ListenConfig(
                file.bus.listen,
                work.shared,
                file.access.routers,
                security(file.access, file.world.name, started),
            ),
            deadlines=file.deadlines,
            limits=file.access.limits,
            keep=work.profile,
            epoch=next_epoch(past, system.time()),
            algorithm=algorithm,
            queued=work.queued,
            system=system,
        )
        told.journal = RunJournal(file, told.coordinator, past, say)

    def life(self) -> Generator[None, None, int]:
        """Run the world to its end, turn by turn; the exit code."""
        told = self._told
        try:
            ended = yield from self.coordinator.life()
        finally:
            told.record.close()
            told.journal.close()
            if told.collected is not None:
                told.collected.close()
        told.ended(ended)
        return 0


class _Told:
    """What the launcher is told, and the record, of a world that runs."""

    coordinator: Coordinator
    journal: RunJournal

    def __init__(self, reports: Reports, elsewhere: Collection[str]) -> None:
        self._elsewhere = elsewhere
        self.record = RunRecord()
        self.collected: CollectSink | None = None
        self._reports = reports
        self._began = False
        self._members = 0

    def watchers(self) -> Watchers:
        """Those who tell it."""
        tell = self._reports.tell
        return Watchers(
            said=self._said,
            status=self._status,
            listening=lambda endpoint: tell(
                "listening", endpoint=endpoint, listens_at=self.coordinator.admission.listens_at
            ),
            stalled=lambda member, waited: tell("stalled", member=member, waited=waited),
            came=lambda member: tell("came", member=member),
            frame_done=self._frame_done,
            idle=lambda: self.record.idle(),
            operated=lambda: self.journal.operated(),
            stopping=lambda reason: tell("stopping", reason=reason),
            restart=self._restart,
            opened=self._opened,
        )

    def _restart(self, member: str) -> str:
        if member in self._elsewhere:
            return f"{member} does not run here: start it anew where it runs"
        self._reports.tell("restart", member=member)
        return ""

    def _opened(self, session: Any) -> list[Any]:
        record, keys = self.record, self.coordinator.keys
        return overhear(session, keys, record.topics, record.received) if record.topics else []

    def _frame_done(self, done: s.FrameDone) -> None:
        self.journal.frame(done)
        self.record.frame(done)
        if self.collected is not None:
            self.collected.frame_done(done)
        if not self._began:
            self._began = True
            self._members = len(self.coordinator.algorithm.members.active())
            self._reports.tell(
                "first_frame", frame=done.frame, at=self.coordinator.schedule.last_frame_at
            )

    def _said(self, member: str, text: str, details: str) -> None:
        self.record.said(member, f"{text}\n{details}" if details else text)
        self._reports.tell("said", member=member, text=text, details=details)

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
            last_frame_at=coordinator.schedule.last_frame_at,
            members=max(self._members, coordinator.status.most_members),
            figures=dict(ended.figures),
            profile=coordinator.metrics.profile(),
        )


def _obey(commands: int, coordinator: Coordinator) -> None:
    lines = Lines()
    while data := os.read(commands, 4096):
        for line in lines.feed(data):
            obey(line, coordinator)


def obey(line: str, coordinator: Coordinator) -> None:
    """Do what the launcher commands; from any thread."""
    word, _, rest = line.partition(" ")
    if word == "log":
        level, member, text = rest.split(" ", 2)
        coordinator.inbox.put(Printed(member, text, level))
    elif word == "started":
        coordinator.inbox.put(Started(rest))
    elif word == "gave_up":
        coordinator.inbox.put(s.Abandoned(rest))
    elif word == "end":
        coordinator.inbox.put(s.End(rest))
    elif word == "stop":
        coordinator.inbox.put(s.End("interrupted", hurried=True))
