"""What a person may ask and tell a running world, through a command, a window or a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent


@dataclass(frozen=True, slots=True)
class MemberStatus:
    """One member and how it is doing.

    `joins` counts the processes of this name that have joined, the first one and those after it.
    `wait` is for how long its answers are waited for, in microseconds a frame; `figures` are what
    it says itself of how it does, such as how much was `dropped`.
    """

    name: str
    state: str
    roles: tuple[str, ...] = ()
    service: str = ""
    kinds: tuple[str, ...] = ()
    generates: tuple[str, ...] = ()
    orders: tuple[str, ...] = ()
    draws: tuple[str, ...] = ()
    last_reply: int = -1
    late: int = 0
    pid: int = 0
    host: str = ""
    expected: bool = False
    joins: int = 0
    wait: float = 0.0
    figures: Mapping[str, bool | int | float | str] = field(
        default_factory=dict[str, bool | int | float | str]
    )

    def figures_shown(self) -> str:
        """The figures as a person reads them, what was dropped first."""
        first = sorted(self.figures.items(), key=lambda pair: (pair[0] != "dropped", pair[0]))
        return ", ".join(
            f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in first
        )


@dataclass(frozen=True, slots=True)
class LogEntry:
    """An event of a frame, or a word about a member; `number` counts them all up from 1."""

    number: int
    frame: int
    about: str
    text: str


@dataclass(frozen=True, slots=True)
class LogLine:
    """What a member has printed, or what the world has said of it.

    `time` is in seconds since 1970; `number` counts the lines of the world up from 1; `frame` is
    the one under way. `level` is info for what a member prints, warning for what is said of it.
    """

    number: int
    time: float
    member: str
    text: str
    frame: int = 0
    level: str = "info"


@dataclass(frozen=True, slots=True)
class WorldStatus:
    """How a running world is doing.

    `rate` is what is wanted (frames per second; 0: as many as go) and `hz` what is reached;
    `left` how many frames a paused world still runs; `events` are per second by type; `phases`
    are the parts of a frame in microseconds and `bytes_in`, `bytes_out` its bytes, each the mean
    over the last frames. `waiting` are those that a frame waits for, `waited` seconds so far.
    `refused` tells how much was refused, by whose it was: members, people, strangers.
    `late_frames` is how many frames took longer than real time, and `behind` by how many seconds.
    """

    world: str
    frame: int
    dt: float
    phase: str
    paused: bool = False
    left: int = 0
    rate: float = 0.0
    hz: float = 0.0
    agents: int = 0
    waiting: tuple[str, ...] = ()
    waited: float = 0.0
    members: tuple[MemberStatus, ...] = ()
    events: Mapping[str, float] = field(default_factory=dict[str, float])
    phases: Mapping[str, float] = field(default_factory=dict[str, float])
    bytes_in: float = 0.0
    bytes_out: float = 0.0
    happenings: tuple[LogEntry, ...] = ()
    refused: Mapping[str, int] = field(default_factory=dict[str, int])
    late_frames: int = 0
    behind: float = 0.0

    @property
    def orders(self) -> tuple[str, ...]:
        """The event types that somebody takes people's orders for, sorted."""
        return tuple(sorted({order for member in self.members for order in member.orders}))

    @property
    def time(self) -> float:
        """Simulated seconds since the world began."""
        return self.frame * self.dt


class Operator(Protocol):
    """A person's hands on a running world; may be used from any thread.

    Each raises BusError where the world does not answer, and where it refuses.
    """

    def status(self, since: int = 0) -> WorldStatus:
        """How the world is doing; `happenings` are those after the one numbered `since`."""
        ...

    def fragment(self, agent: str) -> str:
        """The text of one agent, with what is in its scope."""
        ...

    def order(self, event: AnyEvent) -> None:
        """Send an event into the world, through those who take orders for its type."""
        ...

    def pause(self) -> None:
        """Begin no frame until `resume` or `step`."""
        ...

    def resume(self) -> None:
        """Go on."""
        ...

    def step(self, frames: int = 1) -> None:
        """Run so many frames and pause."""
        ...

    def set_rate(self, rate: float) -> None:
        """Begin so many frames a second; 0: as many as go."""
        ...

    def restart(self, member: str) -> None:
        """Start a process of the world file anew."""
        ...

    def drain(self, member: str) -> Sequence[str]:
        """Let other hosts take over the agents of a host; which hosts."""
        ...

    def logs(self, since: int = 0, member: str = "") -> Sequence[LogLine]:
        """What members have printed and what was said of them, after the line `since`."""
        ...


class Nobody:
    """The operator of a world that takes no orders: all it says is so."""

    def __getattr__(self, name: str) -> object:
        raise MisuseError("nobody can operate this world from here")
