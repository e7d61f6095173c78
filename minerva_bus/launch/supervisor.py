"""The launcher: starts a world's processes, watches them, restarts what fails, ends them all."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

from minerva_bus.launch import starters
from minerva_bus.launch.capacity import make_room
from minerva_bus.launch.console import Console, live_line, starting_line
from minerva_bus.launch.context import LaunchContext
from minerva_bus.launch.ending import how_ended
from minerva_bus.launch.failures import REPORT_BEGINS
from minerva_bus.launch.interrupts import caught
from minerva_bus.launch.machine import REAL, Machine
from minerva_bus.launch.members import LAST_WORDS, Members, Watched
from minerva_bus.launch.memory import prepared, sweep
from minerva_bus.launch.profiling import NOTHING, Profiling
from minerva_bus.launch.recording import check_record
from minerva_bus.launch.registry import Claim
from minerva_bus.launch.starters import FAILED
from minerva_bus.launch.succession import MAX_SUCCESSIONS, Succession
from minerva_bus.launch.summary import FirstFrame, Laps, Summary
from minerva_bus.launch.traces import blocked_at
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.member import RAISED, RAISED_BY_CHANCE
from minerva_bus.runtime.session import POOL_BYTES, expect_links
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wording import counted

GRACE = 1.0
CLOSING = 10.0
"""Seconds that members have after a world's regular end to close their files."""
LAST_PAGE = 5.0
MAX_LINE_LENGTH = 2000
LASTING = "has failed by the same error in the same frame again"


class Supervisor:
    """Runs one world in processes, from the first to the last."""

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        profiling: Profiling = NOTHING,
        coordinator: Callable[..., Coordinator] = Coordinator,
        machine: Machine = REAL,
    ) -> None:
        self._machine = machine
        self._file = file
        self._console = console
        self._laps = Laps(began)
        self._last_words = LAST_PAGE if profiling.member else LAST_WORDS
        around = self._around = LaunchContext(file, profiling, machine)
        self._coordinator = Succession(around, coordinator, self._on_report, self._on_last_line)
        self._members = Members(around, lambda name, line: self._log(name, line, "info"))
        self._claim: Claim | None = None
        self._last_line = ""
        self._first: FirstFrame | None = None
        self._interrupts = 0
        self._stopping, self._why = False, ""
        self._ended: dict[str, Any] | None = None
        self._failure = ""
        self._deadline: float | None = None

    def run(self) -> Summary:
        """Run the world to its end. Raises BusError and MisuseError where it cannot begin."""
        check_record(self._file)
        make_room(len(self._members))
        expect_links(len(self._file.processes))
        self._claim = Claim(self._file.world.name)
        try:
            self._around.shared = self._shares_memory()
            self._laps.end("imports and checks")
            with caught(self._around.pipes, self._on_interrupt):
                self._run()
        finally:
            self._console.end()
            self._around.close()
            if self._around.shared:
                sweep()
            self._claim.release()
        return self._summary()

    def _shares_memory(self) -> bool:
        needed = POOL_BYTES * (1 + len(self._members))
        return prepared(self._file.bus.shared_memory, self._file.world.scene, needed, self._note)

    def _run(self) -> None:
        try:
            self._coordinator.start(self._members.names)
            while self._busy():
                self._turn()
        finally:
            self._kill_all()

    # --- one turn ---

    def _busy(self) -> bool:
        return self._coordinator.child is not None or self._members.running

    def _turn(self) -> None:
        self._around.pipes.wait(self._patience())
        self._reap()
        now = self._machine.monotonic()
        for watched in self._members:
            if watched.restart_at is not None and now >= watched.restart_at:
                self._members.ask_to_start(watched)
            if watched.left_at is not None and now >= watched.left_at and not self._stopping:
                self._on_failure(watched, 0)
        self._start_members()
        if self._deadline is not None and now >= self._deadline:
            self._log_unfinished()
            self._kill_all()

    def _start_members(self) -> None:
        """Start those whose turn it is; the coordinator waits for them from then on."""
        if self._stopping or self._deadline is not None:
            self._members.starting.cancel()
        while (watched := self._members.start_next()) is not None:
            self._coordinator.command(f"started {watched.process.name}")

    def _patience(self) -> float:
        times = [at for watched in self._members for at in watched.times]
        now = self._machine.monotonic()
        times += [
            at for at in (self._deadline, self._members.starting.look_at(now)) if at is not None
        ]
        return max(0.0, min(times) - now) if times else 1.0

    # --- what the coordinator says ---

    def _on_report(self, report: dict[str, Any]) -> None:
        getattr(self, f"_on_{report.pop('kind')}")(**report)

    def _on_listening(self, endpoint: str, listens_at: str) -> None:
        """Processes of this machine come in at `endpoint`, others where it `listens_at`."""
        self._around.endpoint, self._coordinator.listens_at = endpoint, listens_at
        assert self._claim is not None
        self._claim.publish(endpoint)
        if self._coordinator.count:
            self._tell_again()
            return
        self._laps.end("bus")
        self._note(f"{counted(len(self._members), 'process')}, bus at {endpoint}")
        elsewhere = ", ".join(one.name for one in self._file.processes if one.elsewhere)
        if elsewhere:
            self._note(f"{elsewhere} have to be attached to it")
        for note in self._file.notes:
            self._note(note)
        if self._deadline is None:
            for watched in self._members:
                self._members.ask_to_start(watched)

    def _tell_again(self) -> None:
        """Tell a coordinator that has followed another one who will not come back."""
        self._note(f"another coordinator is at {self._around.endpoint}")
        if self._stopping:  # Its journal ends with a frame, before what ended the world.
            self._coordinator.command(f"end {self._why}")
        for watched in self._members:
            if watched.gave_up or (self._stopping and watched.child is None):
                self._gave_up(watched)
            elif watched.child is not None and watched.came_at is None:
                self._coordinator.command(f"started {watched.process.name}")

    def _on_said(self, member: str, text: str, details: str = "") -> None:
        watched = self._members.get(member)
        if watched is not None and REPORT_BEGINS.match(text):
            watched.cause = text
        if REPORT_BEGINS.match(text):
            text = self._members.failures.shown(text)
        if text:
            self._console.log(member, text, "warning")
        self._console.details(member, details)

    def _on_noted(self, text: str) -> None:
        self._note(text)

    def _on_status(self, **status: Any) -> None:
        world = self._file.world
        self._console.frame = self._coordinator.frame = int(status["frame"])
        if self._first is None and not status["frame"] and status["waiting"]:
            self._show_start(status)
            return
        self._console.live(live_line(world.name, status, world.frames, self._laps.began))

    def _show_start(self, status: dict[str, Any]) -> None:
        """Show how many have come: in a bar on a terminal, else in a line now and then."""
        name, total = self._file.world.name, len(self._file.processes)
        text, now = starting_line(status, total), self._machine.monotonic()
        if self._console.terminal:
            self._console.progress(name, min(int(status["members"]), total), total, text)
        else:
            self._console.now_and_then(f"{name}: {text}", now)

    def _on_first_frame(self, frame: int, at: float) -> None:
        if self._first is None:
            self._laps.end("members and frame 0")
            self._first = FirstFrame(frame, at, self._laps.total)

    def _on_came(self, member: str) -> None:
        watched = self._members.get(member)
        if watched is not None:
            watched.come(self._coordinator.frame)
            self._members.starting.over(member)

    def _on_stalled(self, member: str, waited: float) -> None:
        watched = self._members.get(member)
        elsewhere = any(process.name == member for process in self._file.processes)
        if watched is None and elsewhere and not self._stopping:
            self._log(member, f"has not answered for {waited:.0f} s: start it anew where it runs")
        if watched is None or watched.child is None:
            return
        watched.waited = waited
        self._log_stacks(watched, f"has not answered for {waited:.0f} s: it is killed")
        self._machine.kill(watched.child.pid)

    def _log_stacks(self, watched: Watched, text: str) -> None:
        """Say something of a process that does not answer, and in which line it is."""
        name, stacks = watched.process.name, self._members.stacks(watched)
        place = blocked_at(stacks, starters.__file__)
        if place is not None:
            shown = "\n".join([f"{text}; it is still in", *place.lines()])
            text = self._members.failures.shown(shown) or f"{text} (as above)"
        self._log(name, text)
        if stacks:
            self._console.details(name, "\n".join(stacks))
            self._keep(name, "\n".join(stacks), "warning")

    def _on_restart(self, member: str) -> None:
        watched = self._members.get(member)
        if watched is None or self._stopping:
            return
        self._log(member, "is started anew, as a person wants it")
        watched.restart()

    def _on_stopping(self, reason: str) -> None:
        self._stopping, self._why = True, reason

    def _on_ended(self, **ended: Any) -> None:
        self._ended = ended
        regular = not (self._failure or self._interrupts or ended["failed"])
        self._deadline = self._machine.monotonic() + (CLOSING if regular else self._last_words)

    def _on_last_line(self, line: str) -> None:
        self._last_line = line
        self._console.log(COORDINATOR, line)

    # --- processes that end ---

    def _reap(self) -> None:
        while (ended := self._machine.next_ended()) is not None:
            self._on_exit(*ended)

    def _on_exit(self, pid: int, code: int) -> None:
        if self._coordinator.child is not None and pid == self._coordinator.child.pid:
            self._on_coordinator_exit(code)
            return
        watched = self._members.ended(pid)
        if watched is None:
            return
        if self._stopping or self._deadline is not None:
            if self._coordinator.count:
                self._gave_up(watched)
        elif watched.wanted:
            watched.wanted, watched.restart_at = False, self._machine.monotonic()
        elif code == 0:
            watched.leave()
        else:
            self._on_failure(watched, code)

    def _on_coordinator_exit(self, code: int) -> None:
        self._coordinator.ended()
        running = self._ended is None and self._deadline is None
        if running and self._coordinator.may_go_on(code):
            number = self._coordinator.count + 1
            ended = f"failed ({self._last_line})" if code == FAILED else how_ended(code)
            how = f"{ended}; another one goes on from its journal"
            self._console.log(COORDINATOR, f"{how} ({number} of {MAX_SUCCESSIONS})", "warning")
            self._coordinator.go_on(self._members.starting.queued)
            return
        if self._ended is not None:
            return  # Its members' deadline is set.
        if not self._failure:
            self._failure = self._last_line or f"the coordinator {how_ended(code)}"
        self._deadline = min(self._deadline or 1e18, self._machine.monotonic() + self._last_words)

    def _on_failure(self, watched: Watched, code: int) -> None:
        process = watched.process
        if code in (RAISED, RAISED_BY_CHANCE):
            self._await_cause(watched)
        how = "has failed" if watched.cause else how_ended(code)
        wait = watched.fail(self._coordinator.frame)
        if self._members.failures.lasting(process, code, watched.cause) and wait is not None:
            watched.restart_at = None
            self._stop_for(watched, f"{LASTING}, so it is not started again")
        elif wait is not None:
            times = f"restart {watched.failures} of {process.restarts} in {wait:.2f} s"
            self._log(process.name, f"{how}; {times}")
        elif process.on_failure == "ignore":
            self._log(process.name, f"{how}; the world goes on without it")
            watched.gave_up = True
            self._gave_up(watched)
        else:
            times = f", {watched.failures} times in a row" if watched.failures > 1 else ""
            if code > 0:
                self._await_cause(watched)
            self._stop_for(watched, f"{how}{times}")

    def _stop_for(self, watched: Watched, why: str) -> None:
        """Stop the world because of a process; the summary has the cause in one line."""
        cause = watched.cause.partition("\n")[0]
        self._stop(f"{watched.process.name} {cause or why}")
        more = " (--traceback shows all frames)" if cause and not self._console.traceback else ""
        self._console.log(watched.process.name, f"{why}; the world stops{more}", "error")

    def _await_cause(self, watched: Watched) -> None:
        """Hear why it failed: that comes through the coordinator, perhaps after its death."""
        until = self._machine.monotonic() + LAST_WORDS
        while not watched.cause and (left := until - self._machine.monotonic()) > 0:
            self._around.pipes.wait(left)

    def _gave_up(self, watched: Watched) -> None:
        self._coordinator.command(f"gave_up {watched.process.name}")

    # --- stopping ---

    def _stop(self, failure: str) -> None:
        self._failure = self._failure or failure
        self._coordinator.command("stop")
        self._deadline = self._machine.monotonic() + GRACE

    def _on_interrupt(self, number: signal.Signals) -> None:
        self._interrupts += 1
        if self._interrupts > 1:
            self._deadline = 0.0
        elif self._deadline is None:
            self._stop("interrupted" if number == signal.SIGINT else "terminated")

    def _log_unfinished(self) -> None:
        """Name the members that are killed although the world ended regularly."""
        if self._failure or self._interrupts:
            return
        for watched in self._members:
            if watched.child is not None:
                text = "is still running after the world's end: it is killed; its files may be cut"
                self._console.log(watched.process.name, text, "warning")

    def _kill_all(self) -> None:
        """Nothing of a world is left when it is over, and nothing of it is started any more."""
        self._deadline = 0.0
        if self._coordinator.child is not None:
            self._machine.kill(self._coordinator.child.pid)
        self._members.kill()
        while self._busy() and (ended := self._machine.next_ended(wait=True)) is not None:
            self._on_exit(*ended)

    # --- what people are told ---

    def _note(self, text: str) -> None:
        self._console.note(f"{self._file.world.name}: {text}")

    def _log(self, name: str, line: str, level: str = "warning") -> None:
        """Show a word about a process here, and let the coordinator keep it for others."""
        self._console.log(name, line, level)
        self._keep(name, line, level)

    def _keep(self, name: str, text: str, level: str) -> None:
        for line in text.split("\n"):
            self._coordinator.command(f"log {level} {name} {line[:MAX_LINE_LENGTH]}")

    def _summary(self) -> Summary:
        ended = self._ended
        if ended is None:
            return self._summary_without_coordinator()
        reason = self._failure or str(ended["reason"])
        first = self._first
        summary = Summary(
            world=self._file.world.name,
            frames=int(ended["frames"]),
            digest=str(ended["digest"]),
            reached=bool(ended["reached"]),
            ended=reason,
            wall_seconds=max(0.0, float(ended["last_frame_at"]) - first.at) if first else 0.0,
            first_frame_seconds=first.seconds if first else None,
            members=int(ended["members"]),
            seed=self._file.world.seed,
            startup=self._laps.parts,
            figures=ended["figures"],
            before=first.frame if first else self._file.world.past.frame,
            profile=ended["profile"],
        )
        if ended["failed"] and not self._failure:
            self._failure = reason
        return summary

    def _summary_without_coordinator(self) -> Summary:
        """What the launcher knows by itself; the digest and what members report are lost."""
        self._failure = self._failure or "the world ended without a word"
        world, first = self._file.world, self._first
        return Summary(
            world=world.name,
            frames=self._coordinator.frame,
            digest="",
            reached=False,
            ended=self._failure,
            wall_seconds=max(0.0, self._machine.monotonic() - first.at) if first else 0.0,
            first_frame_seconds=first.seconds if first else None,
            members=sum(watched.came_at is not None for watched in self._members),
            seed=world.seed,
            startup=self._laps.parts,
            figures={},
            before=first.frame if first else world.past.frame,
        )

    @property
    def failure(self) -> str:
        """Why the world had to stop before its end; empty where it did not."""
        return self._failure
