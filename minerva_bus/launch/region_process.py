"""The process of a region: its coordinator and its members, between links to other regions."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

from minerva_bus.errors import ProtocolError, SceneError, WorldStopped
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member import Unready
from minerva_bus.launch.failures import CodeFailure
from minerva_bus.launch.free_running import close_services
from minerva_bus.launch.in_process import members_of
from minerva_bus.launch.pipes import LineBuffer, ReportPipe
from minerva_bus.launch.region_journal import RegionJournal
from minerva_bus.launch.region_times import RegionTimes
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.regions.messages import from_message, to_message
from minerva_bus.regions.outbox import Outbox
from minerva_bus.regions.region import Region
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.region_links import ParcelArrived, RegionAppeared, RegionLinks
from minerva_bus.runtime.runner import Notice
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.keys import Keys

REGIONS: Final = "regions"
"""Stands for a member in errors of the function that assigns regions."""


@dataclass(frozen=True, slots=True)
class RegionStart:
    """A region's process: its number, the endpoints of all regions, and its files.

    `part` is the file for its part of the last string. `again`: a process before this one was
    killed, whose `journal` this one reads.
    """

    file: WorldFile
    number: int
    endpoints: Mapping[int, str]
    part: Path
    journal: Path
    again: bool = False


@dataclass(frozen=True, slots=True)
class _Command:
    """A line of the launcher."""

    word: str
    rest: str


class _State(Enum):
    RUNS = auto()
    HELD = auto()
    ENDED = auto()
    CLOSED = auto()


class RegionProcess:
    """Runs one region, in a single thread: other threads only put arrivals into its queue.

    Commands of the launcher: `hold` lets no further frame begin, and is answered by the number of
    the next one; `until N` lets the frames before N begin; `end REASON` ends the region; `close`
    ends the process.
    """

    def __init__(self, start: RegionStart, reports: ReportPipe) -> None:
        file, partition = start.file, start.file.partition
        assert partition is not None
        self._start = start
        self._reports = reports
        self._arrivals: SimpleQueue[Any] = SimpleQueue()
        self._region = Region(file.world, start.number, partition)
        self._members = members_of(file)
        self._runner = InProcessRunner(self._region.algorithm, self._members, self._observe)
        self._outbox = Outbox()
        self._decoder = Decoder(file.world.vocabulary, file.access.limits)
        self._journal = RegionJournal(start.journal)
        self._links: RegionLinks | None = None
        self._times = RegionTimes(file.rate)
        self._running = False
        self._entered = False
        self._until: int | None = None
        self._state = _State.RUNS

    def run(self, commands: int) -> int:
        """Run the region until the launcher closes it; returns the exit code."""
        try:
            self._running = True
            self._runner.start()
            self._running = False
            if self._start.again:
                self._repeat()
            self._journal.open()
            threading.Thread(target=self._read, args=(commands,), daemon=True).start()
            keys = Keys(self._start.file.world.name)
            number, endpoints = self._start.number, self._start.endpoints
            self._links = RegionLinks(keys, number, endpoints, self._arrivals)
            while self._state != _State.CLOSED:
                self._receive(self._advance())
        except (Unready, WorldStopped, ProtocolError) as error:
            self._reports.send("stopped", text=str(error))
        except Exception as error:
            self._fail(error)
        return 0

    def _repeat(self) -> None:
        """Run the frames of the process before this one again; others have their parcels."""
        for arrived in self._journal.read():
            while self._enter():
                self._run_frame()
            self._accept(arrived)
        while self._enter():
            self._run_frame()
        # The frames that it has repeated were early, so the next one would wait for their rhythm.
        self._times = RegionTimes(self._start.file.rate)

    # --- frames ---

    def _advance(self) -> float | None:
        """Run a frame if possible; seconds until the next one, None: as long as nothing arrives."""
        if self._state == _State.ENDED or not self._enter():
            return None
        frame = self._region.frame
        if self._until is not None and frame >= self._until:
            if self._state == _State.RUNS:
                self._state = _State.HELD
                self._reports.send("held", frame=frame)
            return None
        wait = self._times.due - time.monotonic()
        if wait > 0:
            return wait
        self._run_frame()
        return 0.0

    def _enter(self) -> bool:
        """Whether the next frame can begin: its parcels have arrived, and the world goes on."""
        region = self._region
        if self._entered or region.missing:
            return self._entered
        region.enter()
        self._entered = True
        if region.over:
            self._end(region.over)
            return False
        self._times.plan(resting=region.resting)
        return True

    def _run_frame(self) -> None:
        region = self._region
        self._running = True
        self._runner.handle(s.Begin())
        self._running = self._entered = False
        if self._state == _State.ENDED:
            return
        parcels = region.leave()
        self._outbox.keep(parcels)
        for parcel in parcels:
            if parcel.target == region.number:
                region.receive(parcel)
                self._outbox.acknowledge(parcel)
            elif self._links is not None:
                self._links.send(parcel.target, encode(to_message(parcel)))
        if self._times.completed():
            self._reports.send("status", frame=region.frame)

    def _end(self, reason: str) -> None:
        """End the region between two frames, and report its part of the string."""
        region = self._region
        self._running = True
        self._runner.handle(s.End(reason))
        close_services(self._members)
        self._running = False
        self._state = _State.ENDED
        part = encode(to_message(region.part()))
        self._start.part.write_bytes(part)
        ended, times = self._runner.ended, self._times
        self._reports.send(
            "ended",
            reason=reason,
            reached=region.reached,
            frames=region.frame,
            first_at=times.first_at,
            last_at=times.last_at,
            sent_bytes=0 if self._links is None else self._links.sent_bytes,
            figures={} if ended is None else dict(ended.figures),
        )

    def _observe(self, notice: Notice) -> None:
        if isinstance(notice, s.Notify):
            self._reports.send("log", member=notice.member, text=notice.text)
        elif isinstance(notice, s.Stopping) and self._region.algorithm.failed:
            # A region's algorithm ends by itself only because of a failure.
            self._reports.send("stopped", text=notice.reason)
            self._state = _State.ENDED

    def _fail(self, error: Exception) -> None:
        running = self._runner.direct.running if self._running else None
        member = REGIONS if running is None else running.name
        failure = CodeFailure.of(error, member, self._region.frame)
        self._reports.send(
            "failed",
            member=failure.member,
            frame=failure.frame,
            problem=failure.problem,
            details=failure.details,
        )

    # --- arrivals ---

    def _read(self, commands: int) -> None:
        lines = LineBuffer()
        while data := os.read(commands, 4096):
            for line in lines.feed(data):
                word, _, rest = line.partition(" ")
                self._arrivals.put(_Command(word, rest))

    def _receive(self, seconds: float | None) -> None:
        """Handle what has arrived; wait for it for this time, None: until something arrives."""
        # Not silence: repeated parcels of a region would put off those that it waits for.
        again_in = self._times.again_at - time.monotonic()
        if seconds is None and again_in <= 0:
            self._send_again(self._region.missing)
            again_in = self._times.again()
        try:
            self._handle(self._arrivals.get(timeout=again_in if seconds is None else seconds))
        except Empty:
            return
        while not self._arrivals.empty():
            self._handle(self._arrivals.get())

    def _send_again(self, regions: Iterable[int]) -> None:
        """Send the parcels that these regions may not have."""
        assert self._links is not None
        for region in regions:
            for parcel in self._outbox.kept_for(region):
                self._links.send(region, encode(to_message(parcel)))

    def _handle(self, arrival: RegionAppeared | ParcelArrived | _Command) -> None:
        if isinstance(arrival, ParcelArrived):
            self._accept(arrival)
        elif isinstance(arrival, RegionAppeared):
            # It may be a new process, or parcels were lost with the former link.
            self._send_again([arrival.region])
        else:
            self._obey(arrival)

    def _accept(self, arrived: ParcelArrived) -> None:
        try:
            message = self._decoder.parcel(arrived.data)
            parcel = from_message(message, arrived.source, self._region.number)
            is_new = self._region.receive(parcel)
        except (ProtocolError, SceneError) as error:
            text = f"region {arrived.source} has sent an invalid parcel: {error}"
            raise WorldStopped(text) from None
        if is_new:
            # Before the next parcel of this region acknowledges it.
            self._journal.write(arrived)
        self._outbox.acknowledge(parcel)

    def _obey(self, command: _Command) -> None:
        if command.word == "hold":
            self._until = self._region.frame
            self._reports.send("holds", frame=self._region.frame)
        elif command.word == "until":
            self._until = int(command.rest)
            self._state = _State.RUNS if self._state == _State.HELD else self._state
        elif command.word == "end" and self._state != _State.ENDED:
            self._end(command.rest)
        elif command.word == "close":
            self._state = _State.CLOSED
