"""The regions of a world as processes: here, where they are started, or on other machines."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

from minerva_bus.errors import BusError
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.live import FrameSource
from minerva_bus.launch.regions.ahead import frames_ahead
from minerva_bus.launch.regions.checkpoint import RegionCheckpoint
from minerva_bus.launch.regions.journal import FileJournal, RegionJournal, ReportedJournal
from minerva_bus.launch.regions.terms import TERMS, terms_of
from minerva_bus.launch.temporary_folder import temporary_folder
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.log.entries import part_codec
from minerva_bus.regions.attached import beside
from minerva_bus.regions.journal import CHECKPOINT, encoded
from minerva_bus.regions.region import Region
from minerva_bus.regions.whole import WholeSource
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_bus.runtime.session import LOOPBACK
from minerva_bus.runtime.waiting import Patience
from minerva_bus.wire.keys import name_of_region, number_of_region
from minerva_bus.wire.limits import DEFAULT
from minerva_bus.world.agent import Agent
from minerva_bus.world.kinds import kinds_of
from minerva_bus.world.services import Service

MAX_RESTARTS: Final = 1000
"""Processes of a region that may be killed, without much work between, before the world stops."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionSpec(Process):
    """A region as a process of its world: its number and files, and the endpoints of all regions.

    `world_file` is that of the whole world, with the processes that run in that of the region. It
    has `hosts` in processes of their own, which join at the endpoint `hosts_at`. Regions run
    `ahead` by so many frames. Without a file for its `journal`, the coordinator of the world keeps
    it.
    """

    world_file: WorldFile
    number: int
    ahead: int
    endpoints: Mapping[int, str] = field(default_factory=dict[int, str])
    hosts: tuple[Process, ...] = ()
    hosts_at: str = ""
    journal: Path | None = None

    def make_journal(self) -> RegionJournal:
        """The journal of a process that begins."""
        return ReportedJournal() if self.journal is None else FileJournal(self.journal)

    def at(self, world: str, *, secured: bool) -> RegionSpec:
        """The same region of a running world, with the endpoint where it receives parcels.

        Raises BusError if others cannot reach it there.
        """
        own = self.endpoints[self.number]
        example = "--link tls/HOST:PORT, with a host in its certificate"
        if secured and not own:
            raise BusError(f"{self.name} needs an endpoint for other regions: {example}")
        at = check_endpoint(own or LOOPBACK)
        if secured and not at.secured:
            raise BusError(f"{own} has no certificates, and the world has: {example}")
        if not (secured or at.local):
            raise BusError(f"{own} would admit anyone who can reach it; the world has no keys")
        file = self.world_file
        named = replace(file, world=replace(file.world, name=world))
        return replace(self, world_file=named, endpoints={self.number: at.text})

    @property
    def announces(self) -> bool:
        """Whether regions run on several machines, so that they exchange their endpoints."""
        partition = self.world_file.partition
        return partition is not None and len(self.endpoints) < partition.count


@contextmanager
def in_regions(file: WorldFile) -> Generator[WorldFile]:
    """A world file whose processes are the regions of this one, and those outside of them.

    They run for as long as the block does. It is the same file for a world with one coordinator.
    """
    if file.partition is None:
        yield file
        return
    services = _services(file.processes)
    names = outside_of(file, services)
    outside = [each for each in file.processes if each.name in names]
    inside = [each for each in file.processes if each.name not in names]
    ahead, notes = frames_ahead(file.world, _without(services, names))
    # Processes elsewhere are those of regions elsewhere, which have no launcher for hosts.
    away = all(each.elsewhere for each in inside)
    hosts = [each for each in inside if each.table in file.hosts and not away]
    local = [each for each in inside if each not in hosts]
    with temporary_folder("regions") as folder:
        numbers = range(file.partition.count)
        endpoints = {n: f"unixsock-stream/{folder}/{n}.sock" for n in numbers}
        regions = [
            RegionSpec(
                name_of_region(number),
                agents=_agents_of(inside),
                # A region that is killed repeatedly loses no more than time.
                restarts=MAX_RESTARTS,
                # It may wait for another region, so a time-out would not find the late one.
                patience=Patience(then="wait"),
                world_file=_with(file, local, own),
                number=number,
                ahead=ahead,
                endpoints=endpoints,
                hosts_at=hub,
                hosts=own,
                # A later run with the same journal has no temporary files, nor has another machine.
                journal=None if file.bus.journal or away else folder / f"{number}.journal",
                elsewhere=away,
            )
            for number in numbers
            for hub in [_hub(folder, number, hosts, secured=file.access.keys is not None)]
            for own in [hosts_of(number, hosts)]
        ]
        notes = *file.notes, *notes, *unused_processes(local)
        world = _with(file, (*regions, *outside))
        started = [host for region in regions for host in region.hosts]
        yield replace(world, processes=(*world.processes, *started), notes=notes)


def hosts_of(number: int, hosts: Iterable[Process]) -> tuple[Process, ...]:
    """The processes of these hosts in a region."""
    region = name_of_region(number)
    return tuple([replace(each, name=f"{region}.{each.name}", hub=region) for each in hosts])


def _hub(folder: Path, number: int, hosts: Iterable[Process], *, secured: bool) -> str:
    """Where a region listens for its hosts, as the coordinator does for local processes.

    Other languages do not know sockets of files, which only their owner can open; so if the world
    is secured, they cannot join, as with one coordinator.
    """
    if secured or not any(host.command for host in hosts):
        return f"unixsock-stream/{folder}/{number}-hub.sock"
    return LOOPBACK


def _agents_of(processes: Iterable[Process]) -> tuple[type[Agent], ...]:
    return tuple(dict.fromkeys(agent for process in processes for agent in process.agents))


def unused_processes(inside: Sequence[Process]) -> list[str]:
    """What a person has to know of the processes that the world file gives agents, if several."""
    tables = [process.table for process in inside if process.agents]
    divided = sorted({table for table in tables if tables.count(table) > 1})
    without_effect = "`processes` has no effect with regions, which evolve agents themselves"
    return [f"{', '.join(divided)}: {without_effect}"] if divided else []


def _services(processes: Iterable[Process]) -> dict[str, Service | None]:
    known = [each for each in processes if not each.command]
    return {each.name: each.participant().service for each in known}


def _without(
    services: Mapping[str, Service | None], names: Collection[str]
) -> dict[str, Service | None]:
    return {name: service for name, service in services.items() if name not in names}


def outside_of(file: WorldFile, services: Mapping[str, Service | None]) -> frozenset[str]:
    """The processes that are members of a world's coordinator, beside its regions.

    `services` are those of the processes, by name. What a command does is known only from its
    hello, which the coordinator may refuse.
    """
    commands = [each for each in file.processes if each.command and each.table not in file.hosts]
    return beside(services).union(each.name for each in commands)


def _with(
    file: WorldFile, processes: Sequence[Process], hosts: Sequence[Process] = ()
) -> WorldFile:
    """The world file with these processes, for which the world waits as for its `hosts`."""
    names = frozenset(process.name for process in (*processes, *hosts))
    limits = file.access.limits
    # The report of a region may have a part of its journal, whatever generators may send.
    limits = replace(limits, tick_bytes=max(limits.tick_bytes, DEFAULT.tick_bytes))
    return replace(
        file,
        processes=tuple(processes),
        world=replace(file.world, expected=names),
        access=replace(file.access, limits=limits),
    )


def region_elsewhere(file: WorldFile, name: str, listen: str) -> RegionSpec | None:
    """The region of a world file with this name, to run on another machine than the world.

    It receives parcels at the endpoint `listen`. None: the file has no such region.
    """
    number = number_of_region(name)
    if file.partition is None or number is None or not number < file.partition.count:
        return None
    services = _services(file.processes)
    names = outside_of(file, services)
    inside = [replace(each, elsewhere=False) for each in file.processes if each.name not in names]
    ahead, _ = frames_ahead(file.world, _without(services, names))
    return RegionSpec(
        name,
        agents=_agents_of(inside),
        world_file=_with(file, inside),
        number=number,
        ahead=ahead,
        endpoints={number: listen},
    )


def source_of(file: WorldFile) -> Callable[[FrameAlgorithm], FrameSource] | None:
    """The source of the frames of a world: its regions, or None for its members."""
    regions = [process for process in file.processes if isinstance(process, RegionSpec)]
    if not regions or file.partition is None:
        return None
    return partial(
        WholeSource,
        partition=file.partition,
        names=[region.name for region in regions],
        kinds=kinds_of(regions[0].agents),
        all_kinds=not any(host.command for host in regions[0].hosts),
        codec=part_codec(file.world.vocabulary, file.access.limits),
        terms={TERMS: terms_of(regions[0].world_file, regions[0].ahead)},
        journals=_first_journals(file) if regions[0].elsewhere else {},
        ahead=regions[0].ahead,
    )


def _first_journals(file: WorldFile) -> Mapping[str, bytes]:
    """The journals with which regions on other machines continue a run; they lack its string."""
    partition = file.partition
    if partition is None or not file.world.past.frame:
        return {}
    parts = [Region(file.world, number, partition) for number in range(partition.count)]
    return {
        name_of_region(part.number): encoded(CHECKPOINT, RegionCheckpoint.first(part).encoded())
        for part in parts
    }
