"""What the launcher has of the system that it runs on: a clock, processes and their pipes.

It takes it as an argument, so that a simulation can give it another one.
"""

from __future__ import annotations

import os
import time
from functools import partial
from typing import Final, Protocol

from minerva_bus.launch.capacity import cores
from minerva_bus.launch.children import Coordinating, Joining, coordinate, take_part
from minerva_bus.launch.ending import kill, kill_rest, next_ended
from minerva_bus.launch.pipes import Pipes
from minerva_bus.launch.reports import Reports
from minerva_bus.launch.starters import Child, command, fork
from minerva_bus.wire.keys import COORDINATOR


class Machine(Protocol):
    """A clock in seconds, child processes by their ids, and pipes by their descriptors."""

    def monotonic(self) -> float:
        """The time of a clock that never goes back."""
        ...

    def pipes(self) -> Pipes:
        """Where pipes are heard."""
        ...

    def lifeline(self) -> tuple[int, int]:
        """A pipe that ends when the launcher dies."""
        ...

    def close(self, descriptor: int) -> None:
        """Close a pipe's end."""
        ...

    def write(self, descriptor: int, data: bytes) -> None:
        """Write to a pipe. Raises OSError."""
        ...

    def start_coordinator(self, work: Coordinating, lifeline: int) -> tuple[Child, int, int]:
        """Start a coordinator: its process, where to write commands, where to read reports."""
        ...

    def start_member(self, work: Joining, lifeline: int) -> Child:
        """Start a member's process."""
        ...

    def cores(self) -> int:
        """How many cores there are for the world's processes."""
        ...

    def signal(self, pid: int, number: int) -> None:
        """Send a process a signal."""
        ...

    def kill(self, pid: int) -> None:
        """Kill a child and what it has started."""
        ...

    def kill_rest(self, pid: int) -> None:
        """Kill what a child has started."""
        ...

    def next_ended(self, *, wait: bool = False) -> tuple[int, int] | None:
        """A child that has ended, or that ends while we wait, and its exit code; else None."""
        ...


class RealMachine:
    """The operating system."""

    def monotonic(self) -> float:
        """The time of a clock that never goes back."""
        return time.monotonic()

    def pipes(self) -> Pipes:
        """Where pipes are heard."""
        return Pipes()

    def lifeline(self) -> tuple[int, int]:
        """A pipe that ends when the launcher dies."""
        return os.pipe()

    def close(self, descriptor: int) -> None:
        """Close a pipe's end."""
        os.close(descriptor)

    def write(self, descriptor: int, data: bytes) -> None:
        """Write to a pipe. Raises OSError."""
        os.write(descriptor, data)

    def start_coordinator(self, work: Coordinating, lifeline: int) -> tuple[Child, int, int]:
        """Fork a coordinator: its process, where to write commands, where to read reports."""
        down_read, down_write = os.pipe()
        up_read, up_write = os.pipe()
        child = fork(
            COORDINATOR,
            lambda: coordinate(work, Reports(up_write), down_read),
            (down_read, up_write),
            lifeline,
        )
        os.close(down_read)
        os.close(up_write)
        os.set_blocking(up_read, False)
        os.set_blocking(down_write, False)
        return child, down_write, up_read

    def start_member(self, work: Joining, lifeline: int) -> Child:
        """Fork a member's process, or start its command."""
        process = work.process
        if process.command:
            environment = {
                "MINERVA_WORLD": work.world,
                "MINERVA_CONNECT": work.endpoint,
                "MINERVA_NAME": process.name,
            }
            return command(process.name, process.command, environment, process.folder, lifeline)
        return fork(process.name, partial(take_part, work), (), lifeline)

    def cores(self) -> int:
        """How many cores there are for the world's processes."""
        return cores()

    def signal(self, pid: int, number: int) -> None:
        """Send a process a signal."""
        os.kill(pid, number)

    def kill(self, pid: int) -> None:
        """Kill a child and what it has started."""
        kill(pid)

    def kill_rest(self, pid: int) -> None:
        """Kill what a child has started."""
        kill_rest(pid)

    def next_ended(self, *, wait: bool = False) -> tuple[int, int] | None:
        """A child that has ended, or that ends while we wait, and its exit code; else None."""
        return next_ended(wait=wait)


REAL: Final = RealMachine()
