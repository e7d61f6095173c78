"""Runs the coordinator's process, and starts a successor if it is killed during a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from select import PIPE_BUF
from typing import Any, Final

from minerva_bus.launch.coordinator_process import CoordinatorStart
from minerva_bus.launch.forking import FAILED, ChildProcess
from minerva_bus.launch.machine import LaunchContext
from minerva_bus.launch.pipes import CLOSED, LineReader, parse_report
from minerva_bus.runtime.coordinator import Coordinator

MAX_SUCCESSIONS: Final = 100
MAX_FAILURES: Final = 3
"""Coordinators that may fail in the same frame before the run is given up."""


class Succession:
    """A sequence of coordinator processes; `count` is the number of successors so far.

    `on_report` receives their reports, `on_line` the lines that they print. `listens_at` is the
    endpoint of the first coordinator, which its successors reuse. `frame` is the last frame
    reported.
    """

    def __init__(
        self,
        context: LaunchContext,
        make: Callable[..., Coordinator],
        on_report: Callable[[dict[str, Any]], None],
        on_line: Callable[[str], None],
    ) -> None:
        self._context = context
        self._make = make
        self._on_report = on_report
        self._on_line = on_line
        self._commands = CLOSED
        self._readers: list[LineReader] = []
        self.child: ChildProcess | None = None
        self.count = 0
        self.listens_at = ""
        self.frame = 0
        self._failed_at, self._failures = -1, 0

    def start(self, queued: frozenset[str]) -> None:
        """Start the first coordinator, or a successor that reads the journal.

        `queued`: members that have not been started yet.
        """
        context, again = self._context, self.count > 0
        file, pipes = context.file, context.pipes
        if again:
            # Members reconnect to their previous endpoint.
            file = replace(file, bus=replace(file.bus, listen=self.listens_at))
        profile, shared = context.profiling.frames, context.shared
        start = CoordinatorStart(file, self._make, profile, shared, again, queued)
        started = context.machine.start_coordinator(start, context.lifeline[0])
        self.child, self._commands, reports = started
        self._readers = [
            LineReader(pipes, reports, self._read_report),
            LineReader(pipes, self.child.output, self._on_line),
        ]

    def command(self, line: str) -> None:
        """Send the coordinator a line; a stuck coordinator must not block the launcher."""
        # A longer line could be written in part, and the next command would be lost with it.
        data = line.encode()[: PIPE_BUF - 1].decode(errors="ignore").encode()
        try:
            self._context.machine.write(self._commands, data + b"\n")
        except OSError:
            return  # The coordinator has died or is stuck; the launcher detects both.

    def ended(self) -> None:
        """Read the last reports and lines of a process that has ended."""
        self.child = None
        self._context.machine.close(self._commands)
        self._commands = CLOSED
        # The report about the end may be among these: it decides whether a successor is needed.
        for reader in self._readers:
            reader.finish()

    def may_continue(self, code: int) -> bool:
        """Whether to start a successor: the world runs, and the process was killed or failed.

        A failure that repeats in the same frame is not transient.
        """
        if code == FAILED:
            self._failures = self._failures + 1 if self.frame <= self._failed_at else 1
            self._failed_at = max(self._failed_at, self.frame)
        # Without an endpoint the first coordinator has never listened, so there is no run to
        # continue.
        unexpected = code < 0 or (code == FAILED and self._failures < MAX_FAILURES)
        return unexpected and bool(self._context.endpoint) and self.count < MAX_SUCCESSIONS

    def start_successor(self, queued: frozenset[str]) -> None:
        """Start a successor."""
        self.count += 1
        self.start(queued)

    def _read_report(self, line: str) -> None:
        report = parse_report(line)
        if report is not None:
            self._on_report(report)
