"""The launcher: starts a world's processes, watches them, restarts what fails, ends them all."""

from __future__ import annotations

import os
import selectors
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from types import FrameType
from typing import Any

from minerva_bus.bus.coordinator import BusCoordinator
from minerva_bus.bus.profile import MeasuringCoordinator
from minerva_bus.bus.session import POOL_BYTES
from minerva_bus.errors import WorldStopped
from minerva_bus.launch.children import coordinate, take_part
from minerva_bus.launch.console import Console, live_line
from minerva_bus.launch.memory import column_bytes, has_room, sweep
from minerva_bus.launch.profiling import NOTHING, Profiling
from minerva_bus.launch.recording import check_record
from minerva_bus.launch.registry import Claim
from minerva_bus.launch.reports import Lines, Reports, parsed
from minerva_bus.launch.starters import Child, command, fork
from minerva_bus.launch.summary import Summary
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.protocol.keys import COORDINATOR

GRACE = 1.0
LAST_WORDS = 0.4
LAST_PAGE = 5.0
CALM = 30.0
LONGEST_LINE = 2000
LARGE = 4 * 1024 * 1024
"""Bytes of columns from which on a world's own processes share memory."""


@dataclass(slots=True)
class Watched:
    """One process of the world file and how it is doing."""

    process: Process
    child: Child | None = None
    failures: int = 0
    started: float = 0.0
    restart_at: float | None = None
    left_at: float | None = None
    cause: str = ""
    wanted: bool = False
    lines: Lines = field(default_factory=Lines)


class Supervisor:
    """Runs one world in processes, from the first to the last."""

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        profiling: Profiling = NOTHING,
        coordinator: Callable[..., BusCoordinator] = MeasuringCoordinator,
    ) -> None:
        self._file = file
        self._make_coordinator = coordinator
        self._profiling = profiling
        self._last_words = LAST_PAGE if profiling.member else LAST_WORDS
        self._console = console
        self._began = began
        self._selector = selectors.DefaultSelector()
        self._watched = {process.name: Watched(process) for process in file.processes}
        self._lifeline = os.pipe()
        self._wake = os.pipe()
        self._coordinator: Child | None = None
        self._commands = -1
        self._reports = Lines()
        self._coordinator_output = Lines()
        self._endpoint = ""
        self._ended: dict[str, Any] | None = None
        self._failure = ""
        self._last_line = ""
        self._interrupts = 0
        self._stopping = False
        self._first_frame = 0.0
        self._startup: dict[str, float] = {}
        self._deadline: float | None = None
        self._claim: Claim | None = None
        self._shared = False

    def run(self) -> Summary:
        """Run the world to its end. Raises BusError, and WorldStopped where it had to stop."""
        check_record(self._file)
        self._claim = Claim(self._file.world.name)
        self._prepare_memory()
        self._lap("imports and checks")
        handlers = self._catch_signals()
        try:
            self._start_coordinator()
            while self._busy():
                self._turn()
        finally:
            self._kill_all()
            for number, handler in handlers.items():
                signal.signal(number, handler)
            signal.set_wakeup_fd(-1)
            self._console.end()
            if self._shared:
                sweep()
            self._claim.release()
        return self._summary()

    # --- starting ---

    def _prepare_memory(self) -> None:
        """Use shared memory where every process can have its pool: more would end by a signal."""
        wanted = self._file.bus.shared_memory
        if wanted is False or (wanted is None and column_bytes(self._file.world.scene) < LARGE):
            return
        sweep()
        needed = POOL_BYTES * (1 + len(self._watched))
        self._shared = has_room(needed)
        if wanted and not self._shared:
            self._console.note(
                f"{self._file.world.name}: no room for {needed >> 20} MB of shared memory; large"
                " messages go through sockets"
            )

    def _start_coordinator(self) -> None:
        down_read, down_write = os.pipe()
        up_read, up_write = os.pipe()
        file = self._file
        self._coordinator = fork(
            COORDINATOR,
            lambda: coordinate(
                file,
                Reports(up_write),
                down_read,
                self._profiling.frames,
                self._shared,
                self._make_coordinator,
            ),
            (down_read, up_write),
            self._lifeline[0],
        )
        os.close(down_read)
        os.close(up_write)
        os.set_blocking(up_read, False)
        os.set_blocking(down_write, False)
        self._commands = down_write
        self._listen(up_read, self._on_reports)
        self._listen(self._coordinator.output, self._on_coordinator_output)

    def _start(self, watched: Watched) -> None:
        process, world, endpoint = watched.process, self._file.world.name, self._endpoint
        if process.command:
            environment = {
                "MINERVA_WORLD": world,
                "MINERVA_CONNECT": endpoint,
                "MINERVA_NAME": process.name,
            }
            child = command(
                process.name, process.command, environment, process.folder, self._lifeline[0]
            )
        else:
            sample = process.name == self._profiling.member
            child = fork(
                process.name,
                lambda: take_part(process, world, endpoint, sample, self._shared),
                (),
                self._lifeline[0],
            )
        watched.child, watched.started, watched.restart_at = child, time.monotonic(), None
        watched.lines = Lines()
        self._listen(child.output, lambda: self._on_output(watched))

    # --- one turn ---

    def _busy(self) -> bool:
        return self._coordinator is not None or any(w.child for w in self._watched.values())

    def _turn(self) -> None:
        for key, _ in self._selector.select(self._patience()):
            key.data()
        self._reap()
        now = time.monotonic()
        for watched in self._watched.values():
            if watched.restart_at is not None and now >= watched.restart_at:
                self._start(watched)
            if watched.left_at is not None and now >= watched.left_at and not self._stopping:
                self._on_failure(watched, 0)
        if self._deadline is not None and now >= self._deadline:
            self._kill_all()

    def _patience(self) -> float:
        watched = self._watched.values()
        times = [at for w in watched for at in (w.restart_at, w.left_at) if at is not None]
        if self._deadline is not None:
            times.append(self._deadline)
        return max(0.0, min(times) - time.monotonic()) if times else 1.0

    def _listen(self, descriptor: int, hear: Callable[[], None]) -> None:
        self._selector.register(descriptor, selectors.EVENT_READ, hear)

    def _read(self, descriptor: int) -> bytes | None:
        """What there is to read; None where nothing will come any more."""
        try:
            data = os.read(descriptor, 65536)
        except BlockingIOError:
            return b""
        if data:
            return data
        self._selector.unregister(descriptor)
        os.close(descriptor)
        return None

    # --- what the coordinator says ---

    def _on_reports(self) -> None:
        (key,) = [k for k in self._selector.get_map().values() if k.data == self._on_reports]
        data = self._read(key.fd)
        for line in self._reports.feed(data or b""):
            report = parsed(line)
            if report is not None:
                getattr(self, f"_on_{report.pop('kind')}")(**report)

    def _on_listening(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._lap("bus")
        assert self._claim is not None
        self._claim.publish(endpoint)
        self._console.note(
            f"{self._file.world.name}: {len(self._watched)} processes, bus at {endpoint}"
        )
        for note in self._file.notes:
            self._console.note(f"{self._file.world.name}: {note}")
        if self._deadline is None:
            for watched in self._watched.values():
                self._start(watched)

    def _on_said(self, member: str, text: str) -> None:
        if member in self._watched and text.startswith("failed"):
            self._watched[member].cause = text.splitlines()[0]
        self._console.log(member, text)

    def _on_status(self, **status: Any) -> None:
        world = self._file.world
        self._console.live(live_line(world.name, status, world.frames, self._began))

    def _on_first_frame(self) -> None:
        self._lap("members and frame 0")
        self._first_frame = sum(self._startup.values())

    def _lap(self, what: str) -> None:
        """Note how long a part of the start took: what has passed since the part before."""
        passed = time.monotonic() - self._began
        self._startup[what] = passed - sum(self._startup.values())

    def _on_stalled(self, member: str, waited: float) -> None:
        watched = self._watched.get(member)
        if watched is None or watched.child is None:
            return
        self._log(member, f"has not answered for {waited:.0f} s: it is killed")
        _kill(watched.child.pid)

    def _on_restart(self, member: str) -> None:
        """A person wants a process started anew; that is no failure of it."""
        watched = self._watched.get(member)
        if watched is None or self._stopping:
            return
        self._log(member, "is started anew, as a person wants it")
        watched.wanted = True
        if watched.child is not None:
            _kill(watched.child.pid)
        else:
            watched.restart_at = time.monotonic()

    def _on_stopping(self) -> None:
        self._stopping = True

    def _on_ended(self, **ended: Any) -> None:
        self._ended = ended
        self._deadline = time.monotonic() + self._last_words

    # --- processes that end ---

    def _reap(self) -> None:
        while True:
            try:
                pid, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            self._on_exit(pid, os.waitstatus_to_exitcode(status))

    def _on_exit(self, pid: int, code: int) -> None:
        if self._coordinator is not None and pid == self._coordinator.pid:
            self._coordinator = None
            self._on_reports_left()
            if self._ended is None and not self._failure:
                self._failure = self._last_line or f"the coordinator {_how(code)}"
            self._deadline = min(self._deadline or 1e18, time.monotonic() + self._last_words)
            return
        for watched in self._watched.values():
            if watched.child is not None and watched.child.pid == pid:
                _kill_rest(pid)
                self._drain(watched)
                watched.child = None
                if self._stopping or self._deadline is not None:
                    continue
                if watched.wanted:
                    watched.wanted, watched.restart_at = False, time.monotonic()
                elif code == 0:
                    watched.left_at = time.monotonic() + LAST_WORDS  # Word of the end may follow.
                else:
                    self._on_failure(watched, code)

    def _on_reports_left(self) -> None:
        if any(k.data == self._on_reports for k in self._selector.get_map().values()):
            self._on_reports()

    def _on_failure(self, watched: Watched, code: int) -> None:
        process, now = watched.process, time.monotonic()
        if now - watched.started > CALM:
            watched.failures = 0
        watched.failures += 1
        watched.left_at = None
        name, how = process.name, _how(code)
        if process.on_failure == "restart" and watched.failures <= process.restarts:
            wait = min(5.0, 0.05 * 2 ** (watched.failures - 1))
            watched.restart_at = now + wait
            self._log(
                name, f"{how}; restart {watched.failures} of {process.restarts} in {wait:.2f} s"
            )
        elif process.on_failure == "ignore":
            self._log(name, f"{how}; the world goes on without it")
            self._command(f"gave_up {name}")
        else:
            times = f", {watched.failures} times in a row" if watched.failures > 1 else ""
            self._stop(f"{name} {watched.cause or how}{times}")
            self._console.log(name, f"{watched.cause or how}{times}; the world stops")

    # --- stopping ---

    def _stop(self, failure: str) -> None:
        self._failure = self._failure or failure
        self._command("stop")
        self._deadline = time.monotonic() + GRACE

    def _command(self, line: str) -> None:
        """Tell the coordinator something; one that does not listen must not stop us, too."""
        try:
            os.write(self._commands, line.encode() + b"\n")
        except OSError:
            return  # It has just died, which its exit says, or is stuck, which will be seen.

    def _log(self, name: str, line: str) -> None:
        """Show a process's line here, and let the coordinator keep it for others."""
        self._console.log(name, line)
        self._command(f"log {name} {line[:LONGEST_LINE]}")

    def _on_wake(self) -> None:
        self._read(self._wake[0])

    def _catch_signals(self) -> dict[signal.Signals, Any]:
        os.set_blocking(self._wake[1], False)
        os.set_blocking(self._wake[0], False)
        signal.set_wakeup_fd(self._wake[1], warn_on_full_buffer=False)
        self._listen(self._wake[0], self._on_wake)
        numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD)
        before = {number: signal.getsignal(number) for number in numbers}
        signal.signal(signal.SIGCHLD, _ignore)
        signal.signal(signal.SIGINT, self._on_interrupt)
        signal.signal(signal.SIGTERM, self._on_interrupt)
        return before

    def _on_interrupt(self, number: int, _: FrameType | None) -> None:
        self._interrupts += 1
        if self._interrupts > 1:
            self._deadline = 0.0
        elif self._deadline is None:
            self._stop("interrupted" if number == signal.SIGINT else "terminated")

    def _kill_all(self) -> None:
        """Nothing of a world is left when it is over."""
        if self._coordinator is not None:
            _kill(self._coordinator.pid)
        for watched in self._watched.values():
            watched.restart_at = watched.left_at = None
            if watched.child is not None:
                _kill(watched.child.pid)
        while self._busy():
            try:
                pid, status = os.waitpid(-1, 0)
            except ChildProcessError:
                break
            self._on_exit(pid, os.waitstatus_to_exitcode(status))

    # --- output of members ---

    def _on_output(self, watched: Watched) -> None:
        assert watched.child is not None
        data = self._read(watched.child.output)
        if data is None:
            watched.child.output = -1
            return
        for line in watched.lines.feed(data):
            self._log(watched.process.name, line)

    def _drain(self, watched: Watched) -> None:
        child = watched.child
        while child is not None and child.output >= 0:
            data = self._read(child.output)
            if not data:
                break
            for line in watched.lines.feed(data):
                self._log(watched.process.name, line)
        if child is not None and child.output >= 0:
            self._forget(child.output)
        rest = watched.lines.end()
        if rest:
            self._log(watched.process.name, rest)

    def _forget(self, descriptor: int) -> None:
        if descriptor in self._selector.get_map():
            self._selector.unregister(descriptor)
            os.close(descriptor)

    def _on_coordinator_output(self) -> None:
        found = [
            k for k in self._selector.get_map().values() if k.data == self._on_coordinator_output
        ]
        data = self._read(found[0].fd)
        for line in self._coordinator_output.feed(data or b""):
            self._last_line = line
            self._console.log(COORDINATOR, line)

    # --- the end ---

    def _summary(self) -> Summary:
        ended = self._ended
        if ended is None:
            raise WorldStopped(self._failure or "the world ended without a word")
        reason = self._failure or str(ended["reason"])
        summary = Summary(
            world=self._file.world.name,
            frames=int(ended["frames"]),
            digest=str(ended["digest"]),
            reached=bool(ended["reached"]),
            ended=reason,
            wall_seconds=float(ended["seconds"]),
            first_frame_seconds=self._first_frame,
            members=int(ended["members"]),
            seed=self._file.world.seed,
            startup=self._startup,
            figures=ended["figures"],
            before=self._file.world.past.frame,
            profile=ended["profile"],
        )
        if ended["failed"] and not self._failure:
            self._failure = reason
        return summary

    @property
    def failure(self) -> str:
        """Why the world had to stop before its end; empty where it did not."""
        return self._failure


def _ignore(number: int, frame: FrameType | None) -> None:
    """Do nothing: the wake-up pipe has told already."""


def _kill(pid: int) -> None:
    """Kill a child and what it has started: it leads a group, but for its first moment."""
    _kill_rest(pid)
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def _kill_rest(pid: int) -> None:
    """Kill what a child has started."""
    try:
        os.killpg(pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        return  # A group that is empty, or of zombies.


def _how(code: int) -> str:
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"
