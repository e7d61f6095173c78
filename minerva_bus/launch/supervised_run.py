"""A world that runs in processes: what the supervisor and the handlers of its events share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from minerva_bus.launch.console import Console
from minerva_bus.launch.ending import Ending
from minerva_bus.launch.machine import LaunchContext, Machine
from minerva_bus.launch.process_log import ProcessLog
from minerva_bus.launch.process_table import REPORT_SECONDS, ProcessTable, SupervisedProcess
from minerva_bus.launch.succession import Succession
from minerva_bus.launch.summary import Startup
from minerva_bus.launch.worldfile import WorldFile

STOP_SECONDS: Final = 1.0
"""Time for a world to stop on request before its processes are killed.

It is longer than HURRIED_REPORTS_WITHIN (runtime/monitor.py), so that the coordinator can still
send its report with the digest.
"""

PROFILE_SECONDS: Final = 5.0
"""Time for a member to write its profile after the end of a world."""


@dataclass(frozen=True, slots=True)
class SupervisedRun:
    """The processes of one world, what is logged about them, and how the world begins and ends."""

    context: LaunchContext
    console: Console
    startup: Startup
    ending: Ending
    coordinator: Succession
    log: ProcessLog
    processes: ProcessTable

    @property
    def file(self) -> WorldFile:
        """The world file."""
        return self.context.file

    @property
    def machine(self) -> Machine:
        """The operating system."""
        return self.context.machine

    @property
    def report_seconds(self) -> float:
        """Time for a process to end after the end of the world."""
        # A profile is written after the end of the world.
        return PROFILE_SECONDS if self.context.profiling.member else REPORT_SECONDS

    def stop(self, problem: str) -> None:
        """Stop the world early; see `Ending.problem`."""
        self.ending.fail(problem)
        self.coordinator.command("stop")
        self.ending.deadline = self.machine.monotonic() + STOP_SECONDS

    def abandon(self, process: SupervisedProcess) -> None:
        """Tell the coordinator that a process will not be started again."""
        for name in process.names:
            self.coordinator.command(f"abandoned {name}")
