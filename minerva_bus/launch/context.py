"""What all processes of a run share."""

from __future__ import annotations

from dataclasses import dataclass, field

from minerva_bus.launch.machine import REAL, Machine
from minerva_bus.launch.pipes import Pipes
from minerva_bus.launch.profiling import Profiling
from minerva_bus.launch.worldfile import WorldFile


@dataclass(slots=True)
class LaunchContext:
    """One world, and what its processes share while it runs.

    `endpoint` is where local processes connect ("": not known yet), `shared` whether large
    messages use shared memory. `lifeline` is a pipe that closes when the launcher dies.
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
        """Close pipes after all processes have ended."""
        self.pipes.close()
        for end in self.lifeline:
            self.machine.close(end)
