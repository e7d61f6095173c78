"""Number of processes for agents with `processes = "auto"`, from measured costs.

A second host halves the evolution of agents, and costs the coordinator a request, a reply and its
part of the string. With n hosts a frame takes `work / n + (n - 1) * HOST_SECONDS`; the n with the
shortest frame is chosen, at most the number of cores. The costs of the agents' own code are
unknown before it runs, so `work` is a lower bound: the rule rather starts too few hosts than one
that makes the world slower. The strings are the same for any number.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Final

from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.grammar.traversal import kind_counts
from minerva_bus.launch.capacity import cores
from minerva_bus.launch.shared_processes import SERVICES, sharing
from minerva_bus.launch.worldfile import Process, WorldFile
from minerva_bus.wording import counted
from minerva_bus.world.agent import Agent

HOST_SECONDS: Final = 1.5e-3
"""Time that another host adds to a frame: CPU time of the coordinator, 1.4 to 1.7 ms measured."""

AGENT_SECONDS: Final = 0.65e-6
"""Time of an agent's short method, one by one."""

ROW_SECONDS: Final = 0.03e-6
"""Time of an agent's row in a short method for populations."""


def distributed(file: WorldFile, members: Iterable[Member]) -> WorldFile:
    """The world file with a number of processes for each table that leaves it to this machine.

    If it leaves any, services share one where there are fewer cores than processes. `members` are
    those of the first process of each table.
    """
    if not any(process.automatic for process in file.processes):
        return file
    processes, notes = list[Process](), list[str]()
    for process in file.processes:
        own = list(_hosts(process, file.world)) if process.automatic else [process]
        processes += own
        if process.automatic:
            notes.append(f"{process.name}: {counted(len(own), 'process')} (auto)")
    processes = [*sharing(processes, members, cores())]
    if shared := sum(each.shared for each in processes):
        notes.append(f"{SERVICES}: 1 process for {shared} services (auto)")
    expected = frozenset(process.name for process in processes)
    return replace(
        file,
        processes=tuple(processes),
        world=replace(file.world, expected=expected),
        notes=(*file.notes, *notes),
    )


def _hosts(process: Process, world: World) -> Iterator[Process]:
    counts = kind_counts(*world.scene.pieces)
    work = sum(counts[cls.kind.name] * _seconds(cls) for cls in process.agents)
    count = 1 if world.policy.rules.makes_copies else hosts_for(work, cores())
    for name in names_of(process.name, count):
        yield replace(process, name=name, automatic=False)


def hosts_for(work: float, most: int) -> int:
    """The number of hosts, at most `most`, with the shortest frame; `work` is in seconds."""
    return min(range(1, most + 1), key=lambda n: (work / n + (n - 1) * HOST_SECONDS, n))


def _seconds(cls: type[Agent]) -> float:
    """Time of an agent of this class in a frame, if its code is short."""
    if not cls.activities:
        return 0.0
    return ROW_SECONDS if cls.activities.keys() <= cls.population.keys() else AGENT_SECONDS


def names_of(name: str, count: int) -> list[str]:
    """The names of the processes of a table."""
    return [name] if count == 1 else [f"{name}-{number + 1}" for number in range(count)]


def several_hosts(processes: Iterable[Process]) -> bool:
    """Whether the agents of a table have more than one process."""
    tables = [process.table for process in processes if process.agents]
    return len(set(tables)) < len(tables)
