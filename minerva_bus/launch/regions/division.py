"""Which processes of a world run in its regions, as hosts of these, or beside them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from minerva_bus.launch.regions.ahead import frames_ahead
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.regions.attached import beside
from minerva_bus.wire.keys import name_of_region
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Service


@dataclass(frozen=True, slots=True)
class Division:
    """The processes of a world file: `inside` its regions, or `outside` of them, in its order.

    `hosts` are those inside that have processes of their own in each region. Regions run `ahead` by
    so many frames; `notes` are what a person has to know.
    """

    inside: tuple[Process, ...]
    outside: tuple[Process, ...]
    hosts: tuple[Process, ...]
    ahead: int
    notes: Sequence[str]

    @staticmethod
    def of(file: WorldFile) -> Division:
        """The division of a world file. It constructs the services."""
        known = [each for each in file.processes if not each.command]
        services = {each.name: each.participant().service for each in known}
        names = outside_of(file, services)
        inside = tuple([each for each in file.processes if each.name not in names])
        in_step = {name: each for name, each in services.items() if name not in names}
        ahead, notes = frames_ahead(file.world, in_step)
        return Division(
            inside,
            tuple([each for each in file.processes if each.name in names]),
            tuple([each for each in inside if each.table in file.hosts]),
            ahead,
            notes,
        )

    @property
    def agents(self) -> tuple[type[Agent], ...]:
        """The classes of agents inside."""
        return tuple(dict.fromkeys(agent for each in self.inside for agent in each.agents))

    @property
    def local(self) -> tuple[Process, ...]:
        """The processes that run in that of each region, if hosts have their own."""
        return tuple([each for each in self.inside if each not in self.hosts])

    @property
    def elsewhere(self) -> bool:
        """Whether the regions run on other machines."""
        return all(each.elsewhere for each in self.inside)


def outside_of(file: WorldFile, services: Mapping[str, Service | None]) -> frozenset[str]:
    """The processes that are members of a world's coordinator, beside its regions.

    `services` are those of the processes, by name. What a command does is known only from its
    hello, which the coordinator may refuse.
    """
    commands = [each for each in file.processes if each.command and each.table not in file.hosts]
    return beside(services).union(each.name for each in commands)


def hosts_of(number: int, hosts: Iterable[Process]) -> tuple[Process, ...]:
    """The processes of these hosts in a region."""
    region = name_of_region(number)
    return tuple([replace(each, name=f"{region}.{each.name}", hub=region) for each in hosts])


def hosts_of_regions(file: WorldFile) -> list[Process]:
    """The processes of the hosts in all regions of a world file."""
    hosts = [each for each in file.processes if each.table in file.hosts]
    numbers = range(0 if file.partition is None else file.partition.count)
    return [host for number in numbers for host in hosts_of(number, hosts)]


def unused_processes(inside: Sequence[Process]) -> list[str]:
    """What a person has to know of the processes that the world file gives agents, if several."""
    tables = [process.table for process in inside if process.agents]
    divided = sorted({table for table in tables if tables.count(table) > 1})
    without_effect = "`processes` has no effect with regions, which evolve agents themselves"
    return [f"{', '.join(divided)}: {without_effect}"] if divided else []
