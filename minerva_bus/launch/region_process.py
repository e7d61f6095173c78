"""The process of a region: a member of the world that also has links to the other regions."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from minerva_bus.blame import report
from minerva_bus.errors import WorldStopped
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.live import FrameSource
from minerva_bus.launch.region_journal import RegionJournal
from minerva_bus.launch.region_member import RegionMember
from minerva_bus.launch.temporary_folder import temporary_folder
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.log.entries import part_codec
from minerva_bus.regions.attached import beside
from minerva_bus.regions.whole import WholeSource
from minerva_bus.runtime.arrival import STARTED_HERE
from minerva_bus.runtime.member import MemberProcess
from minerva_bus.runtime.region_links import ParcelArrived, RegionAppeared, RegionLinks
from minerva_bus.runtime.system import Timer
from minerva_bus.runtime.waiting import Patience
from minerva_bus.wire.keys import Keys
from minerva_bus.world.kinds import kinds_of

MAX_RESTARTS: Final = 1000
"""Processes of a region that may be killed, without much work between, before the world stops."""

AGAIN_SECONDS: Final = 1.0
"""Interval at which parcels are sent again to regions that are still awaited."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionSpec(Process):
    """A region as a process of its world: its number and files, and the endpoints of all regions.

    `world_file` is that of the whole world.
    """

    world_file: WorldFile
    number: int
    endpoints: Mapping[int, str] = field(default_factory=dict[int, str])
    journal: Path = field(default_factory=Path)


@dataclass(frozen=True, slots=True)
class _SendAgain:
    """Periodic timer: parcels may have been lost."""


class RegionProcess(MemberProcess):
    """Runs a region: its arrivals from the coordinator and from other regions are in one queue."""

    def __init__(
        self, spec: RegionSpec, endpoint: str, notify: Callable[[str], None], *, shared: bool
    ) -> None:
        self._spec = spec
        self._journal = RegionJournal(spec.journal)
        self._links: RegionLinks | None = None
        self._timer: Timer | None = None
        self._region = RegionMember(
            spec.name, spec.world_file, spec.number, self._journal, self._send, notify
        )
        world = spec.world_file.world.name
        super().__init__(self._region, world, endpoint, notify, shared=shared, arrival=STARTED_HERE)
        self._handlers |= {
            ParcelArrived: self._on_parcel,
            RegionAppeared: lambda appeared: self._region.send_again([appeared.region]),
            _SendAgain: lambda _: self._region.a_second_later(),
        }

    def _declare(self, session: Any) -> list[Any]:
        spec = self._spec
        keys = Keys(spec.world_file.world.name)
        self._links = RegionLinks(keys, spec.number, spec.endpoints, self.inbox)
        self._timer = self._system.every(AGAIN_SECONDS, lambda: self.inbox.put(_SendAgain()))
        return super()._declare(session)

    def _close_service(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self._links is not None:
            self._links.close()

    def _send(self, region: int, data: bytes) -> None:
        if self._links is not None:
            self._links.send(region, data)

    def _on_parcel(self, arrived: ParcelArrived) -> None:
        for reply in self._region.parcel(arrived):
            self.link.send(reply)

    def _described(self, error: Exception) -> str:
        """The error, with the name of the member in this process whose code failed."""
        running = "" if isinstance(error, WorldStopped) else self._region.running
        return f"{running}: {report(error)}" if running else report(error)


@contextmanager
def in_regions(file: WorldFile) -> Generator[WorldFile]:
    """A world file whose processes are the regions of this one, and those outside of them.

    They run for as long as the block does. It is the same file for a world with one coordinator.
    """
    if file.partition is None:
        yield file
        return
    names = outside_of(file.processes)
    outside = [each for each in file.processes if each.name in names]
    inside = tuple(each for each in file.processes if each.name not in names)
    classes = {agent: None for process in inside for agent in process.agents}
    with temporary_folder("regions") as folder:
        numbers = range(file.partition.count)
        endpoints = {n: f"unixsock-stream/{folder}/{n}.sock" for n in numbers}
        regions = [
            RegionSpec(
                name_of_region(number),
                agents=tuple(classes),
                # A region that is killed repeatedly loses no more than time.
                restarts=MAX_RESTARTS,
                # It may wait for another region, so a time-out would not find the late one.
                patience=Patience(then="wait"),
                world_file=_with(file, inside),
                number=number,
                endpoints=endpoints,
                journal=folder / f"{number}.journal",
            )
            for number in numbers
        ]
        yield _with(file, (*regions, *outside))


def outside_of(processes: Iterable[Process]) -> frozenset[str]:
    """The processes that are members of a world's coordinator, beside its regions.

    What a command does is known only from its hello, which the coordinator may refuse.
    """
    known = [each for each in processes if not each.command]
    names = beside({each.name: each.participant().service for each in known})
    return names.union(each.name for each in processes if each.command)


def _with(file: WorldFile, processes: Sequence[Process]) -> WorldFile:
    """The world file with these processes, for which the world waits."""
    names = frozenset(process.name for process in processes)
    return replace(file, processes=tuple(processes), world=replace(file.world, expected=names))


def name_of_region(number: int) -> str:
    """The name of a region as a member."""
    return f"region-{number}"


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
        codec=part_codec(file.world.vocabulary, file.access.limits),
    )
