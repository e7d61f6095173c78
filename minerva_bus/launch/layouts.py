"""Layouts of processes in which one world has to give the same strings, frame by frame.

What an agent becomes depends on its state, its events and its stream of random numbers (equation
3), and on nothing that another process, another hour or another hash seed has differently.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from minerva_bus.launch.access import Access
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.settings.tables import BusSettings, RecordSettings, WatchSettings
from minerva_bus.world.services import Device, Generator, Service


@dataclass(frozen=True, slots=True)
class Layout:
    """How a world runs, and what its code must not see of it.

    `hosts` is how many processes each process of agents becomes; with `in_process` all members are
    in one process, unless one of them is a command.
    """

    name: str
    in_process: bool
    hosts: int
    hash_seed: str
    time_zone: str

    @property
    def environment(self) -> dict[str, str]:
        """The environment variables of its processes."""
        return {"PYTHONHASHSEED": self.hash_seed, "TZ": self.time_zone}

    def runs_in_process(self, file: WorldFile) -> bool:
        """Whether a world file runs in one process here."""
        return self.in_process and not any(process.command for process in file.processes)


LAYOUTS: Final = (
    Layout("one process for all members", True, 1, "5", "MNVA+12"),
    Layout("two processes for each kind of agents", False, 2, "36", "MNVB-14"),
)
"""Local dates always differ between the two. With these two hash seeds, sets of two to four short
texts such as {"a", "b"} or {"left", "right"} have different orders, which they may share by chance
with others.
"""


def left_out(file: WorldFile) -> dict[str, str]:
    """The processes whose events differ from run to run, or that emit none; and why, by name."""
    reasons = {process.name: _reason(process) for process in file.processes}
    return {name: reason for name, reason in reasons.items() if reason}


def _reason(process: Process) -> str:
    service = process.make_service() if process.make_service is not None else None
    return _reason_of(service) if service is not None else ""


def _reason_of(service: Service) -> str:
    if service.interactive or (isinstance(service, Generator) and service.people):
        return "people sit before it"
    if isinstance(service, Generator) and not service.lockstep:
        return "it emits events whenever they come"
    if isinstance(service, Device) and service.rate > 0:
        return "it asks for views by the clock"
    return "" if isinstance(service, Generator) else "it only shows views"


def laid_out(
    file: WorldFile, layout: Layout, omitted: Mapping[str, str], frames: int, record: Path
) -> WorldFile:
    """A world file as it runs in a layout for so many frames: recorded, and closed to others."""
    processes = tuple(
        replace(one, name=name, elsewhere=False)
        for one in file.processes
        if one.name not in omitted
        for name in _names(one, layout.hosts)
    )
    return replace(
        file,
        world=replace(
            file.world,
            frames=min(frames, file.world.frames or frames),
            expected=frozenset(one.name for one in processes),
        ),
        rate=0.0,
        processes=processes,
        bus=BusSettings(shared_memory=file.bus.shared_memory),
        access=Access(),
        record=RecordSettings(str(record)),
        watch=WatchSettings(),
    )


def _names(process: Process, hosts: int) -> list[str]:
    several = [f"{process.name}-of-{hosts}-{number}" for number in range(2, hosts + 1)]
    return [process.name, *several] if process.agents else [process.name]
