"""The regions of a world as processes: here, where they are started, or on other machines."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final

from minerva_bus.errors import BusError, WorldFileError
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.live import FrameSource
from minerva_bus.launch.regions.checkpoint import RegionCheckpoint
from minerva_bus.launch.regions.division import Division, hosts_of, unused_processes
from minerva_bus.launch.regions.journal import FileJournal, RegionJournal, ReportedJournal
from minerva_bus.launch.regions.terms import TERMS, terms_of
from minerva_bus.launch.temporary_folder import temporary_folder
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.log.entries import part_codec
from minerva_bus.regions.journal import CHECKPOINT, encoded
from minerva_bus.regions.region import Region
from minerva_bus.regions.whole import WholeSource
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_bus.runtime.session import LOOPBACK
from minerva_bus.runtime.waiting import Patience
from minerva_bus.wire.keys import name_of_region, number_of_region
from minerva_bus.wire.limits import DEFAULT
from minerva_bus.world.kinds import kinds_of

MAX_RESTARTS: Final = 1000
"""Processes of a region that may be killed, without much work between, before the world stops."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionSpec(Process):
    """A region as a process of its world: its number and files, and the endpoints of all regions.

    `world_file` is that of the whole world, with the processes that run in that of the region. It
    awaits `hosts`, which are processes of their own, and listens for any at the endpoint `hosts_at`
    (empty: nowhere). Regions run `ahead` by so many frames. Without a file for its `journal`, the
    coordinator of the world keeps it.
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
        self._check_hub(secured=secured)
        file = self.world_file
        named = replace(file, world=replace(file.world, name=world))
        return replace(self, world_file=named, endpoints={self.number: at.text})

    def _check_hub(self, *, secured: bool) -> None:
        at = check_endpoint(self.hosts_at or LOOPBACK)
        if at.secured and not secured:
            raise BusError(f"{at.text} needs keys: name those of the region with --keys FOLDER")
        if not (at.secured or at.local):
            example = f"tls/{at.host}:{at.port}, with the keys of the region"
            raise BusError(f"{at.text} would admit anyone who can reach it; listen at {example}")

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
    division = Division.of(file)
    # Regions elsewhere have no launcher for hosts.
    away, hosts = division.elsewhere, division.hosts
    with temporary_folder("regions") as folder:
        numbers = range(file.partition.count)
        endpoints = {n: f"unixsock-stream/{folder}/{n}.sock" for n in numbers}
        regions = [
            RegionSpec(
                name_of_region(number),
                agents=division.agents,
                # A region that is killed repeatedly loses no more than time.
                restarts=MAX_RESTARTS,
                # It may wait for another region, so a time-out would not find the late one.
                patience=Patience(then="wait"),
                world_file=_with(file, division.local, own),
                number=number,
                ahead=division.ahead,
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
        notes = *file.notes, *division.notes, *unused_processes(division.local)
        world = _with(file, (*regions, *division.outside))
        started = [host for region in regions for host in region.hosts if not away]
        yield replace(world, processes=(*world.processes, *started), notes=notes)


def _hub(folder: Path, number: int, hosts: Sequence[Process], *, secured: bool) -> str:
    """Where a region listens for its hosts, as the coordinator does for local processes.

    Empty without hosts. Other languages do not know sockets of files, which only their owner can
    open; so if the world is secured, they cannot join, as with one coordinator.
    """
    if not hosts:
        return ""
    if secured or not any(host.command for host in hosts):
        return f"unixsock-stream/{folder}/{number}-hub.sock"
    return LOOPBACK


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


def region_elsewhere(file: WorldFile, name: str, link: str, listen: str = "") -> RegionSpec | None:
    """The region of a world file with this name, to run on another machine than the world.

    It receives parcels at the endpoint `link`, and its hosts join at `listen`; without one, their
    agents evolve in its process. None: the file has no such region. Raises WorldFileError.
    """
    number = number_of_region(name)
    if file.partition is None or number is None or not number < file.partition.count:
        return None
    division = Division.of(file)
    commands = [each.name for each in division.hosts if each.command]
    if commands and not listen:
        why = f"{commands[0]} is a command, so {name} needs an endpoint where it can join"
        raise WorldFileError(f"{file.path}: {why}: --listen tls/0.0.0.0:PORT")
    here = division.local if listen else division.inside
    # Time-outs do not kill what is elsewhere.
    hosts = [replace(each, elsewhere=True) for each in division.hosts if listen]
    own = hosts_of(number, hosts)
    return RegionSpec(
        name,
        agents=division.agents,
        world_file=_with(file, [replace(each, elsewhere=False) for each in here], own),
        number=number,
        ahead=division.ahead,
        endpoints={number: link},
        hosts_at=listen,
        hosts=own,
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
        services=[
            each.participant().hello()
            for each in regions[0].world_file.processes
            if each.make_service is not None
        ],
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
