"""Services that share a process of the operating system, where cores are few."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

from minerva_bus.frame.member import Member
from minerva_bus.frame.messages import Hello
from minerva_bus.launch.worldfile import Process

SERVICES: Final = "services"
"""Name of the process that services share."""

DEFAULT: Final = Process("")


def by_process(processes: Iterable[Process]) -> dict[str, tuple[Process, ...]]:
    """The processes that run here, by name of the process of the operating system."""
    members: dict[str, list[Process]] = {}
    for process in processes:
        if not process.elsewhere:
            members.setdefault(SERVICES if process.shared else process.name, []).append(process)
    return {name: tuple(each) for name, each in members.items()}


def sharing(
    processes: Sequence[Process], members: Iterable[Member], cores: int
) -> tuple[Process, ...]:
    """The processes; services share one if all of them and the coordinator exceed the cores.

    `members` are those of the first process of each table.
    """
    hellos = {member.name: member.hello() for member in members if member.service is not None}
    tables = {
        process.table: hellos[process.name] for process in processes if process.name in hellos
    }
    alike = [
        process
        for process in processes
        if process.table in tables
        and not process.elsewhere
        # They are restarted together.
        and (process.on_failure, process.restarts) == (DEFAULT.on_failure, DEFAULT.restarts)
        and _may_share(tables[process.table])
    ]
    enough = len(by_process(processes)) < cores
    if enough or len(alike) < 2 or SERVICES in {process.name for process in processes}:
        return tuple(processes)
    return tuple(
        replace(process, shared=True) if process in alike else process for process in processes
    )


def _may_share(hello: Hello) -> bool:
    """Whether a member may share a process: frames wait for it, or nobody does."""
    return hello.coupled or not hello.draws
