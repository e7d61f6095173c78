"""The launcher's interface to the operating system, and the context of a run.

A simulation passes a machine of its own.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

from minerva_bus.launch import child_processes, machine_resources
from minerva_bus.launch.child_processes import ChildProcess, Pipes, ReportPipe
from minerva_bus.launch.coordinator_process import CoordinatorStart, run_coordinator
from minerva_bus.launch.member_process import MemberStart, Profiling, run_member
from minerva_bus.launch.world_files import WorldFile


class Machine:
    """A clock, child processes by their ids, and pipes by their descriptors."""

    def monotonic(self) -> float:
        """Seconds of a monotonic clock."""
        return time.monotonic()

    def cores(self) -> int:
        """Number of cores for the processes of a world."""
        return machine_resources.cores()

    # --- pipes ---

    def pipes(self) -> Pipes:
        """A set of pipes to wait for."""
        return Pipes()

    def lifeline(self) -> tuple[int, int]:
        """A pipe that closes when the launcher dies."""
        return os.pipe()

    def close(self, descriptor: int) -> None:
        """Close an end of a pipe."""
        os.close(descriptor)

    def write(self, descriptor: int, data: bytes) -> None:
        """Write to a pipe. Raises OSError."""
        os.write(descriptor, data)

    # --- processes ---

    def start_coordinator(
        self, start: CoordinatorStart, lifeline: int
    ) -> tuple[ChildProcess, int, int]:
        """Start a coordinator; returns its process and the pipes for commands and reports."""
        command_read, command_write = os.pipe()
        report_read, report_write = os.pipe()
        child = child_processes.fork(
            lambda: run_coordinator(start, ReportPipe(report_write), command_read),
            (command_read, report_write),
            lifeline,
        )
        # The child has its own copies; with these open, the end of a pipe would not be detected.
        os.close(command_read)
        os.close(report_write)
        os.set_blocking(report_read, False)
        os.set_blocking(command_write, False)  # A stuck coordinator must not block the launcher.
        return child, command_write, report_read

    def start_member(self, start: MemberStart, lifeline: int) -> ChildProcess:
        """Start the process of members, or the command of its only one."""
        process = start.members[0]
        if process.command:
            environment = {
                "MINERVA_WORLD": start.world,
                "MINERVA_CONNECT": start.endpoint,
                "MINERVA_NAME": process.name,
            }
            return child_processes.command(process.command, environment, process.folder, lifeline)
        read, write = os.pipe()
        child = child_processes.fork(
            partial(run_member, start, ReportPipe(write)), (write,), lifeline
        )
        os.close(write)
        os.set_blocking(read, False)
        return replace(child, reports=read)

    def signal(self, pid: int, number: int) -> None:
        """Send a signal to a process."""
        os.kill(pid, number)

    def is_stopped(self, pid: int) -> bool:
        """Whether a process is stopped by a signal; False where /proc does not exist."""
        try:
            stat = Path(f"/proc/{pid}/stat").read_text()
        except OSError:
            return False
        # The name in brackets may contain anything; the state follows it.
        return stat.rpartition(")")[2].split()[:1] in (["T"], ["t"])

    def kill(self, pid: int) -> None:
        """Kill a child and its process group."""
        child_processes.kill(pid)

    def kill_group(self, pid: int) -> None:
        """Kill the processes that a child has started."""
        child_processes.kill_group(pid)

    def next_ended(self, *, wait: bool = False) -> tuple[int, int] | None:
        """Process id and exit code of a child that has ended, or with `wait` of the next one."""
        return child_processes.next_ended(wait=wait)


def stopped_processes(pid: int) -> list[int]:
    """Those of a process and its children that a signal has stopped; empty without /proc."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        children = []
    return [each for each in (pid, *map(int, children)) if REAL.is_stopped(each)]


REAL: Final = Machine()


@dataclass(slots=True)
class LaunchContext:
    """One world, and the context that its processes share while it runs.

    `endpoint` is that for local processes ("": not known yet), and `shared` whether large messages
    use shared memory. `lifeline` is a pipe that closes when the launcher dies.
    """

    file: WorldFile
    profiling: Profiling
    machine: Machine = REAL
    pipes: Pipes = field(init=False)
    lifeline: tuple[int, int] = field(init=False)
    shared: bool = False
    endpoint: str = ""

    def __post_init__(self) -> None:
        self.pipes, self.lifeline = self.machine.pipes(), self.machine.lifeline()

    def close(self) -> None:
        """Close the pipes after all processes have ended."""
        self.pipes.close()
        for end in self.lifeline:
            self.machine.close(end)
