"""Containers: processes of the operating system that run several processes of a world file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from minerva_bus.errors import WorldFileError
from minerva_bus.frame.member import Member
from minerva_bus.frame.messages import Hello
from minerva_bus.launch.worldfile import Process
from minerva_bus.wire.keys import COORDINATOR

SERVICES: Final = "services"
"""Name of the container that the launcher makes."""

DEFAULT: Final = Process("")


def containers(processes: Iterable[Process]) -> dict[str, tuple[Process, ...]]:
    """The processes that run here, by the name of their container; others by their own name."""
    members: dict[str, list[Process]] = {}
    for process in processes:
        if not process.elsewhere:
            members.setdefault(process.container or process.name, []).append(process)
    return {name: tuple(each) for name, each in members.items()}


def check_containers(processes: Iterable[Process], hellos: Mapping[str, Hello], path: Path) -> None:
    """Raise WorldFileError for processes that cannot share one of the operating system.

    `hellos` are those of the members of each table.
    """
    processes = [*processes]
    names = {process.name for process in processes} | {COORDINATOR}
    first: dict[str, Process] = {}
    for process in processes:
        container = process.container
        if not container:
            continue
        where = f'{path}: [process.{process.table}]: container = "{container}"'
        if container in names:
            raise WorldFileError(f"{where} is the name of a process; choose another one")
        hello = hellos.get(process.table)
        if hello is not None and not _may_share(hello):
            raise WorldFileError(
                f"{where} is for members in step, but {hello.service} is an observer, which may be"
                " busy while others answer; give it a process of its own"
            )
        other = first.setdefault(container, process)
        for key in ("on_failure", "restarts"):
            values = getattr(other, key), getattr(process, key)
            if values[0] != values[1]:
                raise WorldFileError(
                    f"{where} restarts all of its members together, so their {key} must be equal:"
                    f" that of {other.name} is {values[0]}, and here it is {values[1]}"
                )


def contained(
    processes: Sequence[Process], members: Iterable[Member], cores: int
) -> tuple[Process, ...]:
    """The processes, with services in a container if they and the coordinator exceed the cores.

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
        and not (process.container or process.elsewhere)
        and (process.on_failure, process.restarts) == (DEFAULT.on_failure, DEFAULT.restarts)
        and _may_share(tables[process.table])
    ]
    taken = {name for process in processes for name in (process.name, process.container)}
    enough = len(containers(processes)) < cores
    if enough or len(alike) < 2 or SERVICES in taken:
        return tuple(processes)
    return tuple(
        replace(process, container=SERVICES) if process in alike else process
        for process in processes
    )


def _may_share(hello: Hello) -> bool:
    """Whether a member may share a process: frames wait for it, or nobody does."""
    return hello.coupled or not hello.draws
