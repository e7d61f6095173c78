"""Runs the coordinator's process, and starts a successor if it is killed during a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from minerva_bus.launch.context import LaunchContext
from minerva_bus.launch.machine import Coordinating
from minerva_bus.launch.pipes import NOWHERE
from minerva_bus.launch.reports import Lines, parsed
from minerva_bus.launch.starters import FAILED, Child
from minerva_bus.runtime.coordinator import Coordinator

MAX_SUCCESSIONS = 100
MAX_FAILURES = 3
"""Coordinators that may fail in the same frame before the run is given up."""


class Succession:
    """A sequence of coordinator processes; `count` is the number of successors so far.

    `on_report` receives their reports, `on_line` the lines that they print. `listens_at` is the
    endpoint of the first coordinator, which its successors reuse. `frame` is the last frame
    reported.
    """

    def __init__(
        self,
        around: LaunchContext,
        make: Callable[..., Coordinator],
        on_report: Callable[[dict[str, Any]], None],
        on_line: Callable[[str], None],
    ) -> None:
        self._around = around
        self._make = make
        self._on_report = on_report
        self._on_line = on_line
        self._commands = self._reports = self._output = NOWHERE
        self._report_lines, self._output_lines = Lines(), Lines()
        self.child: Child | None = None
        self.count = 0
        self.listens_at = ""
        self.frame = 0
        self._failed_at, self._failures = -1, 0

    def start(self, queued: frozenset[str]) -> None:
        """Start the first coordinator, or a successor that reads the journal.

        `queued`: members that are yet to be started.
        """
        around, again = self._around, self.count > 0
        file = around.file
        if again:
            file = replace(file, bus=replace(file.bus, listen=self.listens_at))
        profile, shared = around.profiling.frames, around.shared
        work = Coordinating(file, self._make, profile, shared, again, queued)
        started = around.machine.start_coordinator(work, around.lifeline[0])
        self.child, self._commands, self._reports = started
        self._output = self.child.output
        self._report_lines, self._output_lines = Lines(), Lines()
        around.pipes.listen(self._reports, self._read_reports)
        around.pipes.listen(self._output, self._read_output)

    def command(self, line: str) -> None:
        """Send the coordinator a line; a stuck coordinator must not block the launcher."""
        try:
            self._around.machine.write(self._commands, line.encode() + b"\n")
        except OSError:
            return  # It has died or is stuck; the launcher detects both.

    def ended(self) -> None:
        """Read the last reports and lines of a process that has ended."""
        self.child = None
        self._around.machine.close(self._commands)
        self._commands = NOWHERE
        if self._reports != NOWHERE:
            self._read_reports()
        if self._output != NOWHERE:
            self._read_output()

    def may_go_on(self, code: int) -> bool:
        """Whether to start a successor: the world runs, and the process was killed or failed.

        A failure that repeats in the same frame is not transient.
        """
        if code == FAILED:
            self._failures = self._failures + 1 if self.frame <= self._failed_at else 1
            self._failed_at = max(self._failed_at, self.frame)
        unexpected = code < 0 or (code == FAILED and self._failures < MAX_FAILURES)
        return unexpected and bool(self._around.endpoint) and self.count < MAX_SUCCESSIONS

    def go_on(self, queued: frozenset[str]) -> None:
        """Start a successor."""
        self.count += 1
        self._around.pipes.forget(self._reports)
        self._around.pipes.forget(self._output)
        self.start(queued)

    def _read_reports(self) -> None:
        data = self._around.pipes.read(self._reports)
        if data is None:
            self._reports = NOWHERE
        for line in self._report_lines.feed(data or b""):
            report = parsed(line)
            if report is not None:
                self._on_report(report)

    def _read_output(self) -> None:
        data = self._around.pipes.read(self._output)
        if data is None:
            self._output = NOWHERE
        for line in self._output_lines.feed(data or b""):
            self._on_line(line)
