"""Runs a world as regions in processes: `minerva run --regions N`."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import WorldStopped
from minerva_bus.launch import forking
from minerva_bus.launch.capacity import check_capacity
from minerva_bus.launch.compiling import compile_agents
from minerva_bus.launch.console import Console, live_line
from minerva_bus.launch.failures import CodeFailure
from minerva_bus.launch.forking import how_ended
from minerva_bus.launch.interrupts import caught
from minerva_bus.launch.pipes import LineReader, Pipes, parse_report
from minerva_bus.launch.region_child import RegionChild, start_region
from minerva_bus.launch.region_process import RegionStart
from minerva_bus.launch.summary import RunSummary
from minerva_bus.launch.temporary_folder import temporary_folder
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.regions.merging import Units, merged
from minerva_bus.regions.messages import from_message
from minerva_bus.runtime.session import expect_links
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.limits import ON_DISK

STOP_SECONDS: Final = 1.0
"""Time for all regions to end after the same frame on request, before they are killed."""

CLOSE_SECONDS: Final = 0.5
"""Time for the processes to exit after the end of the world."""


class RegionSupervisor:
    """One world as regions, each with a process of its own. `run` runs it to its end."""

    def __init__(self, file: WorldFile, console: Console, began: float) -> None:
        """`file` has a partition; `began` is the program's start, on the monotonic clock."""
        self._file = file
        self._console = console
        self._began = began
        self._pipes = Pipes()
        self._lifeline = os.pipe()
        self._regions: dict[int, RegionChild] = {}
        self._reason = ""
        self._deadline: float | None = None
        self._holding: dict[int, int] = {}
        self._meeting: int | None = None
        self._shown = (0, began)

    def run(self) -> RunSummary:
        """Run the world to its end. Raises WorldStopped if a region fails."""
        file, partition = self._file, self._file.partition
        assert partition is not None
        check_capacity(partition.count)
        # Before the first fork, because the children inherit both.
        expect_links(partition.count)
        compile_agents(file.processes, self._console.progress)
        for note in file.notes:
            self._console.note(f"{file.world.name}: {note}")
        with temporary_folder("regions") as folder:
            try:
                with caught(self._pipes, self._on_interrupt):
                    self._start(folder, partition.count)
                    while any(region.ended is None for region in self._regions.values()):
                        self._turn()
                        if self._deadline is not None and time.monotonic() >= self._deadline:
                            break  # A region is blocked: its part of the string is lost.
                    self._close()
                return self._summary(folder)
            finally:
                self._console.end()
                self._kill_all()

    def _start(self, folder: Path, count: int) -> None:
        endpoints = {n: f"unixsock-stream/{folder}/{n}.sock" for n in range(count)}
        for number in range(count):
            part, journal = _part(folder, number), folder / f"{number}.journal"
            self._regions[number] = self._fork(
                RegionStart(self._file, number, endpoints, part, journal)
            )

    def _fork(self, start: RegionStart) -> RegionChild:
        region, reports = start_region(start, self._lifeline[0])
        region.readers = [
            LineReader(self._pipes, reports, self._reports_of(region)),
            LineReader(self._pipes, region.child.output, self._lines_of(region)),
        ]
        return region

    def _turn(self) -> None:
        """Wait for reports, output, signals or the deadline, and handle them."""
        deadline = self._deadline
        self._pipes.wait(1.0 if deadline is None else max(0.0, deadline - time.monotonic()))
        while (ended := forking.next_ended()) is not None:
            self._on_exit(*ended)

    def _on_exit(self, pid: int, code: int) -> None:
        region = next(each for each in self._regions.values() if each.child.pid == pid)
        region.running = False
        for reader in region.readers:
            reader.finish()  # Its failure may be among its last reports.
        # One that has ended may be needed to send its last parcels again.
        if self._reason or all(each.ended is not None for each in self._regions.values()):
            return
        why = region.last_line if code > 0 else ""
        died = f"{why or how_ended(code)} in frame {region.frame}"
        if not region.may_continue(code):
            raise WorldStopped(f"region {region.number} {died}; the world stops")
        self._log(
            f"region {region.number}", f"{died}; a new process runs its frames again", "warning"
        )
        os.close(region.commands)
        following = self._fork(replace(region.start, again=True))
        following.frame, following.died_at = region.frame, region.died_at
        following.deaths = region.deaths
        self._regions[region.number] = following

    # --- reports ---

    def _reports_of(self, region: RegionChild) -> Callable[[str], None]:
        def read(line: str) -> None:
            report = parse_report(line)
            if report is not None:
                getattr(self, f"_on_{report.pop('kind')}")(region, **report)

        return read

    def _lines_of(self, region: RegionChild) -> Callable[[str], None]:
        def show(line: str) -> None:
            region.last_line = line
            self._log(f"region {region.number}", line, "info")

        return show

    def _on_status(self, region: RegionChild, frame: int) -> None:
        # A new process repeats earlier frames.
        region.frame = max(region.frame, frame)
        if region.number == 0:
            before, at = self._shown
            now = time.monotonic()
            self._shown = frame, now
            rate = (frame - before) / (now - at)
            status = {"frame": frame, "rate": rate, "waiting": (), "waited": 0.0}
            status["members"] = len(self._regions)
            world = self._file.world
            self._console.live(live_line(world.name, status, world.frames, self._began))

    def _on_log(self, region: RegionChild, member: str, text: str) -> None:
        self._log(f"{member}, region {region.number}", text, "warning")

    def _on_failed(
        self, region: RegionChild, member: str, frame: int, problem: str, details: str
    ) -> None:
        name = f"{member}, region {region.number},"
        raise CodeFailure(name, frame, problem, details).stops(self._console)

    def _on_stopped(self, region: RegionChild, text: str) -> None:
        raise WorldStopped(f"region {region.number}: {text}")

    def _on_ended(self, region: RegionChild, **report: Any) -> None:
        region.ended = report

    # --- ending ---

    def _on_interrupt(self, number: signal.Signals) -> None:
        if self._reason:  # The second one does not wait.
            self._deadline = 0.0
            return
        self._reason = "interrupted" if number == signal.SIGINT else "terminated"
        self._deadline = time.monotonic() + STOP_SECONDS
        self._command_all("hold")

    def _on_holds(self, region: RegionChild, frame: int) -> None:
        """All regions end after the same frame: that of the region which is furthest."""
        self._holding[region.number] = frame
        if len(self._holding) == len(self._regions):
            self._meeting = max(self._holding.values())
            self._command_all(f"until {self._meeting}")

    def _on_held(self, region: RegionChild, frame: int) -> None:
        region.held = frame
        if all(each.held == self._meeting for each in self._regions.values()):
            self._command_all(f"end {self._reason}")

    def _command_all(self, line: str) -> None:
        for region in self._regions.values():
            region.command(line)

    def _close(self) -> None:
        self._command_all("close")
        until = time.monotonic() + CLOSE_SECONDS
        if self._deadline is not None:
            until = min(until, self._deadline)
        while any(each.running for each in self._regions.values()) and time.monotonic() < until:
            self._pipes.wait(until - time.monotonic())
            while (ended := forking.next_ended()) is not None:
                self._on_exit(*ended)

    def _kill_all(self) -> None:
        for region in self._regions.values():
            if region.running:
                forking.kill(region.child.pid)
        while any(each.running for each in self._regions.values()):
            ended = forking.next_ended(wait=True)
            if ended is None:
                break
            for region in self._regions.values():
                region.running &= region.child.pid != ended[0]
        for region in self._regions.values():
            os.close(region.commands)
        self._pipes.close()
        for end in self._lifeline:
            os.close(end)

    def _summary(self, folder: Path) -> RunSummary:
        file = self._file
        reports = [each.ended for each in self._regions.values() if each.ended is not None]
        whole = len(reports) == len(self._regions)
        first = min((each["first_at"] or 0.0 for each in reports), default=0.0)
        last = max((each["last_at"] for each in reports), default=0.0)
        # The members of one region report the figures of all, because generators are equal.
        figures: Mapping[str, Any] = reports[0]["figures"] if whole else {}
        count, frames = len(self._regions), reports[0]["frames"] if whole else 0
        if frames and count > 1:
            sent = sum(each["sent_bytes"] for each in reports)
            figures = {"parcel_bytes": round(sent / (frames * count * (count - 1))), **figures}
        return RunSummary(
            world=file.world.name,
            frames=min(
                each.frame if each.ended is None else each.ended["frames"]
                for each in self._regions.values()
            ),
            digest=self._digest(folder) if whole else "",
            reached=whole and bool(reports[0]["reached"]),
            ended=reports[0]["reason"] if whole else self._reason,
            wall_seconds=max(0.0, last - first) if first else 0.0,
            first_frame_seconds=max(0.0, first - self._began) if first else None,
            members=len(file.processes),
            seed=file.world.seed,
            startup={},
            figures={"regions": count, **figures},
        )

    def _digest(self, folder: Path) -> str:
        decoder = Decoder(self._file.world.vocabulary, ON_DISK)
        parts: list[Units] = []
        for number in self._regions:
            message = decoder.parcel(_part(folder, number).read_bytes())
            parts.append(from_message(message, number, number).units)
        return merged(parts).scene.digest.hex()

    def _log(self, member: str, text: str, level: str) -> None:
        self._console.frame = min(each.frame for each in self._regions.values())
        self._console.log(member, text, level)


def _part(folder: Path, number: int) -> Path:
    """The file for a region's part of the last string."""
    return folder / f"{number}.part"
