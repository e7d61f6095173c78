"""World files: a world's string, its rules, and the processes that run it, in TOML.

    [world]
    string = "PMeadow · AFox#a<x=1, y=2> · AFox#b"   # or scene = "module:function"
    vocabulary = "meadow:vocabulary"
    order = ["eNear", "eHunger", "eRepresent"]

    [process.foxes]
    agents = "meadow:Fox"
    processes = 2

settings/tables.py declares every key, docs/worlds.md lists them, and launch/reading.py reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.launch.access import Access
from minerva_bus.launch.collecting import Collecting
from minerva_bus.runtime.waiting import Deadlines, Patience
from minerva_bus.settings.tables import BusSettings, RecordSettings, WatchSettings
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Service


@dataclass(frozen=True, slots=True)
class Process:
    """One process of a world, and the policy for its failure: restart, stop or ignore.

    `elsewhere`: the world waits for it, but it is started on another machine, by hand or by a
    service manager: `minerva attach WORLD --process NAME`. `speaks_for`: kinds and `#id`s of agents
    in whose name a generator may send events. `table`: the name of its table in the
    world file, empty for a view of the command line. `automatic`: it stands for as many processes
    as `distribution` chooses. `shared`: it shares a process of the operating system with others.
    """

    name: str
    make_service: Callable[[], Service] | None = None
    agents: tuple[type[Agent], ...] = ()
    command: tuple[str, ...] = ()
    folder: Path = field(default_factory=Path)
    on_failure: str = "restart"
    restarts: int = 5
    elsewhere: bool = False
    table: str = ""
    speaks_for: tuple[str, ...] = ()
    patience: Patience | None = None
    automatic: bool = False
    shared: bool = False

    def participant(self) -> Member:
        """The member that this process runs."""
        service = self.make_service() if self.make_service is not None else None
        return Member(self.name, service, self.agents)


@dataclass(frozen=True, slots=True)
class WorldFile:
    """A world file with the settings of the command line, checked.

    `patience` has the time-outs for all members; a process may have its own. `notes` are lines to
    print at the start.
    """

    path: Path
    world: World
    rate: float
    processes: tuple[Process, ...]
    bus: BusSettings = field(default_factory=BusSettings)
    access: Access = field(default_factory=Access)
    patience: Patience = field(default_factory=Patience)
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    notes: tuple[str, ...] = ()
    record: RecordSettings = field(default_factory=RecordSettings)
    text: str = ""
    watch: WatchSettings = field(default_factory=WatchSettings)
    collect: Collecting = field(default_factory=Collecting)

    @property
    def deadlines(self) -> Deadlines:
        """Time-outs of frames for each member."""
        processes = self.processes
        own = {each.name: each.patience for each in processes if each.patience is not None}
        elsewhere = frozenset(process.name for process in processes if process.elsewhere)
        on_failure = {process.name: process.on_failure for process in processes}
        return Deadlines(self.patience, own, elsewhere, on_failure)
