"""The world and the settings of one run from Python, checked before it begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from minerva_bus.api.world import World, own_options
from minerva_bus.arguments import path_of
from minerva_bus.collect.data_tables import check_ending
from minerva_bus.collect.plans import plans_of, read_entries
from minerva_bus.errors import MisuseError
from minerva_bus.launch.world_files import Collecting, WorldFile, several_hosts
from minerva_bus.settings.world_settings import Overrides

if TYPE_CHECKING:
    from minerva_bus.launch.past import WorldSource
    from minerva_bus.launch.replays import Replay

Processes: TypeAlias = int | Literal["auto"] | None
"""Number of processes for each kind of agents; None: as the world says, without a bus."""


@dataclass(frozen=True, slots=True)
class ContinuedRecord:
    """The record that a run continues, or that it plays from frame `begin` if `plays`.

    `speed` is that of a played record: 1: real time; 0: as fast as possible.
    """

    record: str
    plays: bool = False
    begin: int = 0
    speed: float = 1.0

    def read(self, world: WorldSource, overrides: Overrides) -> Replay:
        """The world of the run and its coordinator. Raises RecordError and MinervaError."""
        # Only here: the library of records is an extra.
        from minerva_bus.launch.past import read_resumed
        from minerva_bus.launch.replays import Replay, read_replay
        from minerva_bus.runtime.coordinator import Coordinator

        path = path_of("record", self.record)
        if self.plays:
            return read_replay(path, world, overrides, begin=self.begin, speed=self.speed)
        return Replay(read_resumed(path, world, overrides), Coordinator)


@dataclass(frozen=True, slots=True)
class Request:
    """A world with the settings of one run; `past`: the record that it continues or plays."""

    world: World
    overrides: Overrides
    file: WorldFile
    past: ContinuedRecord | None = None

    def needs_bus(self, bus: bool, processes: Processes) -> bool:
        """Whether the run starts processes, by the arguments `bus` and `processes` of `run`."""
        if processes == "auto":
            return bus or several_hosts(self.file.processes)
        return bus or processes is not None


def request_of(
    world: World,
    options: Mapping[str, Any],
    *,
    collect: Any = None,
    into: str | Path = "",
    processes: Processes = None,
    record: str | Path = "",
    past: ContinuedRecord | None = None,
    **values: Any,
) -> Request:
    """The settings of one run, checked. Raises MinervaError."""
    overrides = Overrides(
        own_options(world, options),
        _processes(world, processes),
        record=str(record) if record else None,
        into=str(into) if into and collect is None else None,
        **values,
    )
    file = world.read(overrides) if past is None else past.read(world.read, overrides).file
    if collect is not None:
        file = _collecting(file, collect, into)
    return Request(world, overrides, file, past)


def _processes(world: World, count: Processes) -> tuple[str, ...]:
    """The settings for this number of processes for each kind of agents."""
    if count is None:
        return ()
    if isinstance(count, int) and count < 1:
        raise MisuseError(f'processes is {count}; expected at least 1, or "auto"')
    # Settings name a table of the world file, which may stand for several processes.
    hosts = [process.table for process in world.file.processes if process.agents]
    return tuple(dict.fromkeys(f"{name}.processes={count}" for name in hosts))


def _collecting(file: WorldFile, collect: Any, into: str | Path) -> WorldFile:
    entries = read_entries(collect)
    if into != "":
        check_ending(path_of("into", into))
    # The plans are made for their checks: errors appear here, before any process starts.
    plans_of(entries, file.world.vocabulary)
    return replace(file, collect=Collecting(entries, str(into)))
