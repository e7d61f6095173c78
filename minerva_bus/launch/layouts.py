"""Process layouts in which a world must produce the same strings, frame by frame.

An agent evolves by its state, its events and its stream of random numbers (equation 3) only, so the
result must not depend on the process, the hash seed or the time zone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from minerva_bus.launch.access import Access
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.settings.tables import BusSettings, RecordSettings, WatchSettings
from minerva_bus.world.service_attributes import when_of
from minerva_bus.world.services import Generator


@dataclass(frozen=True, slots=True)
class Layout:
    """A layout of processes for one run of a world.

    `hosts`: number of processes for each process of agents. `in_process`: all members in one
    process, unless one of them is a command.
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
"""Chosen to reveal mistakes: local dates always differ between the two layouts. Sets of two to
four short texts such as {"a", "b"} have different orders with these seeds, unlike with many others.
"""


def left_out(file: WorldFile) -> dict[str, str]:
    """Processes that cannot be compared, by name, with the reason."""
    reasons = {process.name: _reason(process) for process in file.processes}
    return {name: reason for name, reason in reasons.items() if reason}


def _reason(process: Process) -> str:
    if process.make_service is None:
        return ""
    service = process.make_service()
    if service.interactive or (isinstance(service, Generator) and service.people):
        return "people operate it"
    when = when_of(service)
    if isinstance(service, Generator) and not when.is_awaited:
        return "it runs freely"
    if when.rate > 0:
        return "it requests views by the clock"
    return "" if isinstance(service, Generator) else "it only shows views"


def laid_out(
    file: WorldFile, layout: Layout, omitted: Mapping[str, str], frames: int, record: Path
) -> WorldFile:
    """A world file for a run of `frames` in a layout: recorded, and closed to other members."""
    processes = tuple(
        replace(process, name=name, elsewhere=False)
        for process in file.processes
        if process.name not in omitted
        for name in _names(process, layout.hosts)
    )
    return replace(
        file,
        world=replace(
            file.world,
            frames=min(frames, file.world.frames or frames),
            expected=frozenset(process.name for process in processes),
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
