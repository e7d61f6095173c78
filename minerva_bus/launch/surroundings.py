"""What all processes of a run are started in."""

from __future__ import annotations

from dataclasses import dataclass, field

from minerva_bus.launch.machine import REAL, Machine
from minerva_bus.launch.pipes import Pipes
from minerva_bus.launch.profiling import Profiling
from minerva_bus.launch.worldfile import WorldFile


@dataclass(slots=True)
class Surroundings:
    """One world, and what its processes have in common while it runs.

    `endpoint` is where processes of this machine come in ("": nowhere yet), `shared` whether large
    messages go through shared memory. `lifeline` is a pipe whose end tells that the launcher died.
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
        """All processes have ended."""
        self.pipes.close()
        for end in self.lifeline:
            self.machine.close(end)
