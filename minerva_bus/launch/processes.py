"""The tables [process.NAME] of a world file, and the views that a command line adds."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.frame.compatibility import incompatibility
from minerva_bus.frame.participant import Participant
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.launch.options import beside
from minerva_bus.launch.overrides import Overrides, read_view
from minerva_bus.launch.patience import KEYS, read_patience
from minerva_bus.launch.specs import bind, find_agents, find_service
from minerva_bus.launch.table import Table
from minerva_bus.launch.worldfile import Process
from minerva_bus.runtime.waiting import Patience
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.world.services import Service

MOST_PROCESSES: Final = 1000
"""Of one sort."""


def read_processes(top: Table, path: Path, given: Overrides) -> tuple[Process, ...]:
    """The processes of a world file, in its order, and after them the views that are wanted.

    Raises WorldFileError.
    """
    reader = _Reader(top, path, given.coordinator_only)
    table, settings = top.table("process"), given.by_process()
    found: list[Process] = []
    for name in list(table.data):
        found += reader.processes(name, table.table(name), settings.pop(name, {}))
    for view in given.views:
        spec, name, options = read_view(view)
        cls = find_service(spec, path.parent)
        make = reader.maker(name, cls, options | settings.pop(name, {}))
        found.append(Process(name, make, on_failure="ignore"))
    if settings:
        name = next(iter(settings))
        known = [process.name for process in found]
        raise WorldFileError(f"--set: there is no process {name!r}{nearest(name, known)}")
    return tuple(found)


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads one table [process.NAME] after the other."""

    top: Table
    path: Path
    elsewhere: bool

    def processes(self, name: str, table: Table, settings: dict[str, Any]) -> list[Process]:
        """The processes of one table: as many as it wants, or one."""
        table.data.update(settings)
        checked = table.named(name, "a process")
        count = table.whole("processes", 1, 1, MOST_PROCESSES)
        plain = Process(
            checked,
            on_failure=table.choice("on_failure", ("restart", "stop", "ignore")),
            restarts=table.whole("restarts", 5),
            elsewhere=table.truth("elsewhere", False) or self.elsewhere,
            speaks_for=table.texts("speaks_for"),
            patience=self._patience(table),
        )
        names = [checked] if count == 1 else [f"{checked}-{i + 1}" for i in range(count)]
        agents, command = table.texts("agents"), table.texts("command")
        service = table.text("service")
        if sum(map(bool, (agents, command, service))) != 1:
            raise WorldFileError(
                f"{self.path}: [process.{name}] needs exactly one of service, agents and command"
            )
        if agents and plain.speaks_for:
            table.wrong("speaks_for", "is for generators: agents speak for themselves")
        folder = self.path.parent
        if service:
            options = {key: beside(value, folder) for key, value in table.rest().items()}
            with table.loading("service"):
                cls = find_service(service, folder)
            makers = {one: self.maker(one, cls, options) for one in names}
            return [
                replace(plain, name=one, make_service=make, alike=names[0])
                for one, make in makers.items()
            ]
        table.done()
        if command and shutil.which(command[0], path=self._path()) is None:
            table.wrong("command", f"names {command[0]!r}, which is no program")
        with table.loading("agents"):
            classes = tuple(cls for spec in agents for cls in find_agents(spec, folder))
        plain = replace(plain, agents=classes, command=command, folder=folder)
        return [replace(plain, name=one, alike=names[0]) for one in names]

    def _path(self) -> str:
        return os.pathsep.join([str(self.path.parent), os.environ.get("PATH", os.defpath)])

    def maker(
        self, name: str, cls: type[Service], options: dict[str, Any]
    ) -> Callable[[], Service]:
        """What makes the service of a process."""
        return bind(cls, options, f"{self.path.name}: [process.{name}]")

    def _patience(self, table: Table) -> Patience | None:
        """The patience with a process, where it is not that with all."""
        if not any(key in table for key in KEYS):
            return None
        return read_patience(table, read_patience(self.top.table("bus"), Patience()))


def check_members(
    processes: Iterable[Process], vocabulary: Vocabulary, path: Path
) -> list[Participant]:
    """Let each member say hello to the world once, before anything is started.

    Of the processes of one table the first speaks for all: they differ in their names only.
    Raises WorldFileError.
    """
    seen: set[str] = set()
    members: list[Participant] = []
    for process in processes:
        if process.name in seen:
            raise WorldFileError(f"{path}: two processes are called {process.name}")
        seen.add(process.name)
        if process.name == COORDINATOR:
            raise WorldFileError(f"{path}: the name {COORDINATOR} is taken")
        if not process.command and process.alike in ("", process.name):
            members.append(process.participant())
            reason = incompatibility(members[-1].hello(), vocabulary)
            if reason:
                raise WorldFileError(f"{path}: [process.{process.name}]: {reason}")
    return members
