"""A simulated machine for the real launcher: processes, pipes and a clock."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Generator
from itertools import count
from typing import Any, Final

from minerva_bus.launch.child_processes import CLOSED, ChildProcess, LineBuffer, Pipes, ReportPipe
from minerva_bus.launch.coordinator_process import CoordinatorRun, CoordinatorStart, handle_command
from minerva_bus.launch.process_table import Machine, MemberStart
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.joining import STARTED_HERE
from minerva_bus.runtime.participants import MemberProcess
from minerva_bus.wire.keys import COORDINATOR
from tests.simulator.network import Network
from tests.simulator.process import SimulatedProcess
from tests.simulator.timeline import Timeline

PIPE: Final = 20e-6, 200e-6
"""Seconds until data written to a pipe are readable."""

LAST: Final = 1.0
"""Seconds within which the end of a killed process is reported."""


class SimulatedPipes(Pipes):
    """Pipes in memory. The first wait of a turn only reads; others let time pass."""

    def __init__(self, timeline: Timeline, wake: Callable[[], None]) -> None:
        self.waits = False
        self._timeline = timeline
        self._wake = wake
        self._numbers = count(1000)
        self._data: dict[int, bytearray] = {}
        self._over: dict[int, None] = {}
        self._handlers: dict[int, Callable[[], object]] = {}

    def open(self) -> int:
        """Open a pipe and return its descriptor."""
        number = next(self._numbers)
        self._data[number] = bytearray()
        return number

    def arrive(self, descriptor: int, data: bytes) -> None:
        """Add data to a pipe; b"" closes it."""
        if descriptor not in self._data:
            return
        if data:
            self._data[descriptor] += data
        else:
            self._over[descriptor] = None
        self._wake()

    def listen(self, descriptor: int, on_ready: Callable[[], object]) -> None:
        """Call `on_ready` when the pipe has data to read or has reached its end."""
        self._handlers[descriptor] = on_ready

    def wait(self, seconds: float | None) -> None:
        """Call the handlers of ready pipes; if the launcher `waits`, let time pass first."""
        if self.waits and seconds is not None:
            self._timeline.run(self._timeline.now + seconds, lambda: bool(self.readable()))
        self.waits = True
        for descriptor in self.readable():
            if descriptor in self._handlers:
                self._handlers[descriptor]()

    def wait_for(self, descriptor: int, seconds: float) -> bool:
        """Whether a pipe has data now."""
        return descriptor in self.readable()

    def read(self, descriptor: int) -> bytes | None:
        """Available data; None after the end."""
        data = bytes(self._data.get(descriptor, b""))
        # Data that arrived before the end are read first.
        if data or descriptor not in self._over:
            if data:
                self._data[descriptor].clear()
            return data
        self.forget(descriptor)
        return None

    def forget(self, descriptor: int) -> None:
        """Close a pipe if it is open."""
        if descriptor != CLOSED:
            self._handlers.pop(descriptor, None)
            self._data.pop(descriptor, None)
            self._over.pop(descriptor, None)

    def close(self) -> None:
        """Close all pipes."""
        self._data.clear()
        self._handlers.clear()

    def readable(self) -> list[int]:
        """Pipes that have data or have ended."""
        return [pipe for pipe in self._handlers if self._data.get(pipe) or pipe in self._over]


class SimulatedReports(ReportPipe):
    """Reports of a simulated coordinator."""

    def __init__(self, process: SimulatedProcess, send: Callable[[bytes], None]) -> None:
        super().__init__(CLOSED)
        self._process = process
        self._send = send

    def send(self, kind: str, **fields: Any) -> None:
        """Send a report; a dead process sends none."""
        if self._process.alive:
            self._send(json.dumps({"kind": kind, **fields}).encode() + b"\n")


class SimulatedMachine(Machine):
    """A machine whose processes share one thread; `woken` is called when the launcher has news."""

    def __init__(self, timeline: Timeline, network: Network, woken: Callable[[], None]) -> None:
        self.timeline = timeline
        self.network = network
        self.processes: dict[int, SimulatedProcess] = {}
        self.ended: deque[tuple[int, int]] = deque()
        self._pipes = SimulatedPipes(timeline, woken)
        self._woken = woken
        self._pids = count(100)
        self._commands: dict[int, Callable[[bytes], None]] = {}
        self._chance = timeline.stream("pipes")
        self._arrives: dict[int, float] = {}

    # --- the launcher's interface ---

    def monotonic(self) -> float:
        """Simulated seconds."""
        return self.timeline.now

    def pipes(self) -> SimulatedPipes:
        """The pipes of the launcher."""
        return self._pipes

    def lifeline(self) -> tuple[int, int]:
        """Unused: here the launcher outlives its world."""
        return self._pipes.open(), self._pipes.open()

    def close(self, descriptor: int) -> None:
        """Close a pipe's end."""
        self._commands.pop(descriptor, None)

    def write(self, descriptor: int, data: bytes) -> None:
        """Write to a pipe. Raises OSError if its reader is dead."""
        if descriptor not in self._commands:
            raise BrokenPipeError
        self._later(descriptor, lambda: self._command(descriptor, data))

    def _command(self, descriptor: int, data: bytes) -> None:
        if descriptor in self._commands:
            self._commands[descriptor](data)

    def start_coordinator(
        self, start: CoordinatorStart, lifeline: int
    ) -> tuple[ChildProcess, int, int]:
        """Start a coordinator; returns its process and the pipes for commands and reports."""
        commands, reports = self._pipes.open(), self._pipes.open()
        process, child = self._process(COORDINATOR, (reports,))
        sink = SimulatedReports(process, lambda data: self._written(reports, data))
        self._commands[commands] = obeyed = _Obeyed(process)

        def life() -> Generator[None, None, int]:
            run = CoordinatorRun(start, sink, process.system)
            obeyed.begin(run.coordinator)
            return run.life()

        process.start(life)
        return child, commands, reports

    def start_member(self, start: MemberStart, lifeline: int) -> ChildProcess:
        """Start a member's process."""
        process, child = self._process(start.name, ())

        def life() -> Generator[None, None, int]:
            # With the time-outs of a member that the launcher starts: a coordinator that is frozen
            # for seconds must not count as failures of members.
            member = MemberProcess(
                [member.make_member() for member in start.members],
                start.world,
                start.endpoint,
                process.log,
                arrival=STARTED_HERE,
                system=process.system,
            )
            return member.life()

        process.start(life)
        return child

    def cores(self) -> int:
        """A small number, so that members start in turns."""
        return 1

    def signal(self, pid: int, number: int) -> None:
        """Do nothing: there are no stacks to request."""

    def is_stopped(self, pid: int) -> bool:
        """Whether a process is frozen."""
        return self.timeline.now < self.processes[pid].frozen_until

    def kill(self, pid: int) -> None:
        """Kill a process."""
        self.processes[pid].kill()

    def kill_group(self, pid: int) -> None:
        """Do nothing: a simulated process starts no others."""

    def next_ended(self, *, wait: bool = False) -> tuple[int, int] | None:
        """The next ended child with its exit code, or None."""
        if wait:
            self.timeline.run(self.timeline.now + LAST, lambda: bool(self.ended))
        return self.ended.popleft() if self.ended else None

    # --- implementation ---

    def _process(self, name: str, pipes: tuple[int, ...]) -> tuple[SimulatedProcess, ChildProcess]:
        pid, output = next(self._pids), self._pipes.open()

        def log(line: str) -> None:
            self.timeline.note(name, line)
            self._written(output, line.encode() + b"\n")

        def exited(code: int) -> None:
            self.timeline.note(name, f"ended with {code}")
            # Pipes end after their last data, and the exit is reported after the last pipe has
            # ended.
            for pipe in (output, *pipes):
                self._later(pipe, lambda pipe=pipe: self._pipes.arrive(pipe, b""))
            last = max(self._arrives[pipe] for pipe in (output, *pipes))
            self.timeline.at(last, lambda: self._has_ended(pid, code))

        process = SimulatedProcess(name, self.timeline, self.network, exited, log)
        self.processes[pid] = process
        return process, ChildProcess(pid, output)

    def _has_ended(self, pid: int, code: int) -> None:
        """Report an end only after all output can be read."""
        self.ended.append((pid, code))
        self._woken()

    def _written(self, descriptor: int, data: bytes) -> None:
        self._later(descriptor, lambda: self._pipes.arrive(descriptor, data))

    def _later(self, descriptor: int, call: Callable[[], None]) -> None:
        """Schedule something on a pipe, which keeps its order."""
        at = self.timeline.now + self._chance.uniform(*PIPE)
        at = self._arrives[descriptor] = max(at, self._arrives.get(descriptor, 0.0))
        self.timeline.at(at, call)


class _Obeyed:
    """Reads the commands for a coordinator; earlier ones wait for its start."""

    def __init__(self, process: SimulatedProcess) -> None:
        self._process = process
        self._lines = LineBuffer()
        self._before: list[bytes] = []
        self._coordinator: Coordinator | None = None

    def __call__(self, data: bytes) -> None:
        """Execute received commands."""
        if self._coordinator is None:
            # The launcher may write as soon as the pipe exists.
            self._before.append(data)
        else:
            # A frozen process executes commands when it continues.
            self._process.system.call(lambda: self._obey(data))

    def begin(self, coordinator: Coordinator) -> None:
        """Execute earlier commands, and then new ones."""
        self._coordinator = coordinator
        for data in self._before:
            self._obey(data)

    def _obey(self, data: bytes) -> None:
        assert self._coordinator is not None
        for line in self._lines.feed(data):
            handle_command(line, self._coordinator)
