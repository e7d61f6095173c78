"""World files: a world's string, its rules, and the processes that run it, in TOML.

    [world]
    string = "PMeadow · AFox#a<x=1, y=2> · AFox#b"   # or scene = "module:function"
    vocabulary = "meadow:vocabulary"
    order = ["eNear", "eHunger", "eRepresent"]

    [process.foxes]
    agents = "meadow:Fox"
    processes = 2

docs/worlds.md has every key, and launch/reading.py reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from minerva_bus.frame.description import World
from minerva_bus.frame.participant import Participant
from minerva_bus.launch.border import Border
from minerva_bus.launch.keeping import RecordSettings
from minerva_bus.launch.watching import WatchSettings
from minerva_bus.runtime.waiting import Deadlines, Patience
from minerva_bus.world.agent import Agent
from minerva_bus.world.services import Service


@dataclass(frozen=True, slots=True)
class Process:
    """One process of a world, and what happens when it fails: restart, stop or ignore.

    `elsewhere`: the world waits for it, but it is started on another machine, by hand or by
    whatever runs things there: `minerva attach WORLD --process NAME`. `speaks_for`: kinds and
    `#id`s of agents in whose name a generator may send events. `alike`: the first of the processes
    that the same table describes.
    """

    name: str
    make_service: Callable[[], Service] | None = None
    agents: tuple[type[Agent], ...] = ()
    command: tuple[str, ...] = ()
    folder: Path = field(default_factory=Path)
    on_failure: str = "restart"
    restarts: int = 5
    elsewhere: bool = False
    alike: str = ""
    speaks_for: tuple[str, ...] = ()
    patience: Patience | None = None

    def participant(self) -> Participant:
        """The member that this process is."""
        service = self.make_service() if self.make_service is not None else None
        return Participant(self.name, service, self.agents)


@dataclass(frozen=True, slots=True)
class BusSettings:
    """Where the coordinator listens and how long a frame waits for a member, seconds.

    `shared_memory`: large messages between processes of the world file do not go through sockets;
    None: where the initial string is large, and where there is room for it. `border`: who may come
    from elsewhere. `journal`: the folder of the journal from which the world goes on whenever it
    was stopped ("": among what runs here, for as long as it runs).
    """

    listen: str = "tcp/127.0.0.1:0"
    patience: Patience = field(default_factory=Patience)
    shared_memory: bool | None = None
    border: Border = field(default_factory=Border)
    journal: str = ""


@dataclass(frozen=True, slots=True)
class WorldFile:
    """All that a world file says, checked; `notes` are what people should know of it."""

    path: Path
    world: World
    rate: float
    processes: tuple[Process, ...]
    bus: BusSettings
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    notes: tuple[str, ...] = ()
    record: RecordSettings = field(default_factory=lambda: RecordSettings())
    text: str = ""
    watch: WatchSettings = field(default_factory=WatchSettings)

    @property
    def deadlines(self) -> Deadlines:
        """How long a frame waits for each member."""
        own = {one.name: one.patience for one in self.processes if one.patience is not None}
        elsewhere = frozenset(one.name for one in self.processes if one.elsewhere)
        on_failure = {one.name: one.on_failure for one in self.processes}
        return Deadlines(self.bus.patience, own, elsewhere, on_failure)
