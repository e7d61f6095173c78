"""The parts of a world that runs in this process: the members of its file, and what runs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from minerva_bus.errors import MinervaError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member import Member
from minerva_bus.launch.free_running import FreeRunning
from minerva_bus.launch.recording import RunRecord
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.runner import Notice


@dataclass(slots=True)
class WorldParts:
    """The parts of an open world."""

    runner: InProcessRunner
    members: list[Member]
    record: RunRecord
    services: FreeRunning
    closed: bool = False


def members_of(file: WorldFile) -> list[Member]:
    """The members of all processes. Raises MinervaError for one that needs its own process."""
    for process in file.processes:
        if process.command:
            raise MinervaError(f"{process.name} is a command of its own: run without --in-process")
        if process.elsewhere:
            raise MinervaError(f"{process.name} runs elsewhere: run without --in-process")
    return [process.participant() for process in file.processes]


def recorded(record: RunRecord) -> Callable[[Notice], None]:
    """The sink that records each frame of a run."""

    def observe(notice: Notice) -> None:
        if isinstance(notice, s.FrameDone):
            record.frame(notice)

    return observe
