"""A region's process as its launcher knows it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from minerva_bus.launch import forking
from minerva_bus.launch.forking import ChildProcess
from minerva_bus.launch.pipes import LineReader, ReportPipe
from minerva_bus.launch.region_process import RegionProcess, RegionStart

MAX_DEATHS: Final = 3
"""Processes of a region that may be killed in the same frame before the world stops."""


@dataclass(slots=True)
class RegionChild:
    """A region's process, and what it has reported.

    `frame` is its next frame, `held` that at which it waits, and `ended` its last report.
    """

    start: RegionStart
    child: ChildProcess
    commands: int
    readers: list[LineReader] = field(default_factory=list[LineReader])
    frame: int = 0
    held: int | None = None
    ended: Mapping[str, Any] | None = None
    last_line: str = ""
    running: bool = True
    died_at: int = -1
    deaths: int = 0

    @property
    def number(self) -> int:
        """The region's number."""
        return self.start.number

    def may_continue(self, code: int) -> bool:
        """Whether another process can run the region after one has ended with this exit code.

        It was killed, its journal is complete, and it does not die in the same frame repeatedly.
        """
        self.deaths = 1 if self.frame > self.died_at else self.deaths + 1
        self.died_at = self.frame
        return code < 0 and self.start.journal.exists() and self.deaths < MAX_DEATHS

    def command(self, line: str) -> None:
        """Send a line; a process that has died is detected by its end."""
        try:
            os.write(self.commands, f"{line}\n".encode())
        except OSError:
            return


def start_region(start: RegionStart, lifeline: int) -> tuple[RegionChild, int]:
    """Start the process of a region, which ends with the launcher; returns its pipe of reports."""
    commands, command_end = os.pipe()
    report_end, reports = os.pipe()

    def body() -> int:
        return RegionProcess(start, ReportPipe(reports)).run(commands)

    child = forking.fork(body, (commands, reports), lifeline)
    # The child has its own copies; with these open, the end of a pipe would not be detected.
    os.close(commands)
    os.close(reports)
    os.set_blocking(report_end, False)
    os.set_blocking(command_end, False)  # A stuck region must not block the launcher.
    return RegionChild(start, child, command_end), report_end
