"""Answers of commands that have only done what they were asked for: fields for JSON, and a text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class _Fields:
    """An answer whose JSON object has its fields."""

    def plain(self) -> dict[str, Any]:
        """The fields by name."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class WorldStopping(_Fields):
    """A world was asked to stop."""

    world: str

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{self.world}: asked to stop"]


@dataclass(frozen=True, slots=True)
class WorldPaused(_Fields):
    """A world has paused before a frame."""

    world: str
    frame: int

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{self.world}: paused before frame {self.frame}"]


@dataclass(frozen=True, slots=True)
class WorldResumed(_Fields):
    """A world was resumed."""

    world: str

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{self.world}: resumed"]


@dataclass(frozen=True, slots=True)
class RateChanged(_Fields):
    """A world has another limit of frames per second; 0: none."""

    world: str
    hz: float

    def lines(self) -> list[str]:
        """The answer as text."""
        limit = f"{self.hz:g} frames per second" if self.hz else "as fast as possible"
        return [f"{self.world}: {limit}"]


@dataclass(frozen=True, slots=True)
class MemberRestarting(_Fields):
    """A process of a world is restarted."""

    world: str
    member: str

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{self.world}: restarting {self.member}"]


@dataclass(frozen=True, slots=True)
class HostDraining(_Fields):
    """The agents of a host move to other hosts."""

    world: str
    member: str
    hosts: tuple[str, ...]

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{self.world}: the agents of {self.member} move to {', '.join(self.hosts)}"]


@dataclass(frozen=True, slots=True)
class ReplayMoved(_Fields):
    """A replay continues at another frame."""

    world: str
    frame: int

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{self.world}: continues from frame {self.frame}"]


@dataclass(frozen=True, slots=True)
class MetricsServed(_Fields):
    """The metrics of a world are served at an address."""

    world: str
    url: str

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{self.world}: metrics at {self.url}"]


@dataclass(frozen=True, slots=True)
class AssistantsServed(_Fields):
    """A server of the Model Context Protocol listens at an address, with some permissions."""

    url: str
    allow: tuple[str, ...]

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"MCP at {self.url} ({', '.join(self.allow) or 'read-only'})"]


@dataclass(frozen=True, slots=True)
class MemberLeft(_Fields):
    """An attached member has left its world.

    `ended` is why the world ended ("": it has not), `failure` how the member failed ("": it has
    not).
    """

    member: str
    world: str
    endpoint: str
    ended: str
    failure: str

    def lines(self) -> list[str]:
        """The answer as text; empty if the member left at the request of its user."""
        failed = [f"{self.member}: failed: {self.failure}"] if self.failure else []
        ended = [f"{self.member}: the world has ended: {self.ended}"] if self.ended else []
        return failed + ended


@dataclass(frozen=True, slots=True)
class FilePlotted(_Fields):
    """A picture was drawn."""

    picture: str

    def lines(self) -> list[str]:
        """The answer as text."""
        return [self.picture]


@dataclass(frozen=True, slots=True)
class MapDrawn(_Fields):
    """The map of a recording was drawn, with messages about the recording and the map."""

    map: str
    notes: tuple[str, ...]

    def lines(self) -> list[str]:
        """The answer as text."""
        return list(self.notes)


@dataclass(frozen=True, slots=True)
class RecoveredTables:
    """The tables of a killed run were joined: their files by table."""

    files: Mapping[str, str]

    def plain(self) -> dict[str, Any]:
        """The tables as a JSON object."""
        return {"tables": {name: {"file": file} for name, file in self.files.items()}}

    def lines(self) -> list[str]:
        """The answer as text."""
        return [f"{file}  {name}" for name, file in self.files.items()]


@dataclass(frozen=True, slots=True)
class FolderCreated(_Fields):
    """A package was created, with commands to run and to test it ("": no tests)."""

    folder: str
    run: str
    test: str = ""
    edit: str = ""

    def lines(self) -> list[str]:
        """The answer as text: the next steps."""
        lines = [f"created {self.folder}; next steps:", f"  cd {self.folder}"]
        if not self.test:
            return [*lines, f"  {self.run}"]
        tested = f"  {self.test:40} # run its tests"
        return [*lines, tested, f"  {self.run:40} # run a small world", f"then edit {self.edit}"]
