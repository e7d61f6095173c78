"""The coordinator's process; where it is killed in the midst of a run, another one follows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from minerva_bus.launch.machine import Coordinating
from minerva_bus.launch.pipes import NOWHERE
from minerva_bus.launch.reports import Lines, parsed
from minerva_bus.launch.starters import FAILED, Child
from minerva_bus.launch.surroundings import Surroundings
from minerva_bus.runtime.coordinator import Coordinator

MAX_SUCCESSIONS = 100
MAX_FAILURES = 3
"""Coordinators that may fail by an exception before one gets beyond their frame."""


class Succession:
    """One coordinator after another: `count` of them have followed the first.

    `told` gets each report of theirs, `printed` each line that they print. `listens_at` is where
    the first one could be reached, and so must the others; `frame` is the last one they reported.
    """

    def __init__(
        self,
        around: Surroundings,
        make: Callable[..., Coordinator],
        told: Callable[[dict[str, Any]], None],
        printed: Callable[[str], None],
    ) -> None:
        self._around = around
        self._make = make
        self._told = told
        self._printed = printed
        self._commands = self._reports = self._output = NOWHERE
        self._report_lines, self._output_lines = Lines(), Lines()
        self.child: Child | None = None
        self.count = 0
        self.listens_at = ""
        self.frame = 0
        self._failed_at, self._failures = -1, 0

    def start(self, queued: frozenset[str]) -> None:
        """Start the first one, or one that goes on from the journal of the last.

        `queued` are the members yet to be started.
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
        around.pipes.listen(self._reports, self._hear_reports)
        around.pipes.listen(self._output, self._hear_output)

    def command(self, line: str) -> None:
        """Tell the coordinator something; one that does not listen must not stop us, too."""
        try:
            self._around.machine.write(self._commands, line.encode() + b"\n")
        except OSError:
            return  # It has just died, which its exit says, or is stuck, which will be seen.

    def ended(self) -> None:
        """The coordinator's process has ended; hear what it said last."""
        self.child = None
        self._around.machine.close(self._commands)
        self._commands = NOWHERE
        if self._reports != NOWHERE:
            self._hear_reports()
        if self._output != NOWHERE:
            self._hear_output()

    def may_go_on(self, code: int) -> bool:
        """Whether another one follows: its world runs, and it was killed, or failed by a defect.

        A defect that shows again in the same frame is not transient.
        """
        if code == FAILED:
            self._failures = self._failures + 1 if self.frame <= self._failed_at else 1
            self._failed_at = max(self._failed_at, self.frame)
        unexpected = code < 0 or (code == FAILED and self._failures < MAX_FAILURES)
        return unexpected and bool(self._around.endpoint) and self.count < MAX_SUCCESSIONS

    def go_on(self, queued: frozenset[str]) -> None:
        """Let another one follow."""
        self.count += 1
        self._around.pipes.forget(self._reports)
        self._around.pipes.forget(self._output)
        self.start(queued)

    def _hear_reports(self) -> None:
        data = self._around.pipes.read(self._reports)
        if data is None:
            self._reports = NOWHERE
        for line in self._report_lines.feed(data or b""):
            report = parsed(line)
            if report is not None:
                self._told(report)

    def _hear_output(self) -> None:
        data = self._around.pipes.read(self._output)
        if data is None:
            self._output = NOWHERE
        for line in self._output_lines.feed(data or b""):
            self._printed(line)
