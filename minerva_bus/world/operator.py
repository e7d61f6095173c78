"""Queries and commands for a running world, as commands, windows and pages send them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import AnyEvent


@dataclass(frozen=True, slots=True)
class MemberStatus:
    """The state of a member.

    `joins` is the number of processes of this name that have joined, including restarts. `wait` is
    the mean time for which a frame waits for its replies, in microseconds, and `sent` the mean size
    of its messages in a frame, in bytes. `figures` are metrics that the member reports itself, such
    as the number of items `dropped`. `outlook` is what the world does if a frame waits for the
    member any longer; empty if none waits.
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
    sent: float = 0.0
    outlook: str = ""
    figures: Mapping[str, bool | int | float | str] = field(
        default_factory=dict[str, bool | int | float | str]
    )

    def figures_shown(self) -> str:
        """The figures as text, with the number of dropped items first."""
        # Dropped items are a problem that its reader should see first.
        first = sorted(self.figures.items(), key=lambda pair: (pair[0] != "dropped", pair[0]))
        return ", ".join(
            f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in first
        )


@dataclass(frozen=True, slots=True)
class LogEntry:
    """An event of a frame, or a remark about a member; `number` counts all entries from 1."""

    number: int
    frame: int
    about: str
    text: str


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line that a member has printed, or that the world has logged about it.

    `time` is in seconds since 1970, `frame` is the current frame, and `number` counts the lines of
    the world from 1. `level` is "info" for output of the member, "warning" for remarks about it.
    """

    number: int
    time: float
    member: str
    text: str
    frame: int = 0
    level: str = "info"


@dataclass(frozen=True, slots=True)
class OrderStatus:
    """An order of a person, and its fate.

    `number` counts the orders of the world from 1, `change` the changes of all orders. `person` is
    empty for a person without a name. `state` is "waiting" (for a frame), "accepted", "rejected",
    "dropped", "done", "failed" or "replaced", since `frame`. `by` is the norm that rejected it, the
    host that its frame ended twice, the agent that reported it, or the order that replaced it.
    `report` is the event that failed it. `open`: another state may follow.
    """

    number: int
    change: int
    person: str
    event: str
    type: str
    state: str
    frame: int
    by: str = ""
    open: bool = True
    report: str = ""

    @property
    def fate(self) -> str:
        """The state in words, such as `rejected by the norm curfew in frame 12`."""
        if self.state == "waiting":
            return "waits for a frame"
        by = {
            "accepted": "", "replaced": f" by {self.by}", "rejected": f" by the norm {self.by}",
            "dropped": f" because {self.by or 'a host'} ended twice",
        }.get(self.state, f", reported by {self.report or f'#{self.by}'},")  # fmt: skip
        return f"{self.state}{by} in frame {self.frame}"


@dataclass(frozen=True, slots=True)
class CollectedSeries:
    """Values that a running world collects: `values` in some of its `frames`, the last included.

    A value is NaN where nothing counted.
    """

    name: str
    unit: str = ""
    frames: tuple[int, ...] = ()
    values: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class PersonOperation:
    """What a person did to the world in a frame: pause, resume, step, rate, restart, drain or stop.

    `value` is the number of frames, the rate or the member; `person` is empty without a name.
    """

    frame: int
    command: str
    value: str = ""
    person: str = ""

    def __str__(self) -> str:
        return f"{f'{self.command} {self.value}'.rstrip()} by {self.person or 'people'}"


@dataclass(frozen=True, slots=True)
class NormStatus:
    """A norm that was broken `broken` times; the last time in `frame`, `by` an agent or a sender.

    `then` is the consequence: refuse, sanction or count. `frame` is -1 if the last time was before
    a resumption of the run.
    """

    name: str
    then: str
    broken: int
    frame: int = -1
    by: str = ""


@dataclass(frozen=True, slots=True)
class FileStatus:
    """A file that the world writes: its record or its journal.

    `problem` is empty while it is written; `lost` is the number of frames that it lacks.
    """

    name: str
    path: str
    problem: str = ""
    lost: int = 0


@dataclass(frozen=True, slots=True)
class WorldStatus:
    """The state of a running world.

    `rate` is the requested number of frames per second (0: no limit) and `hz` the measured one.
    `left` is the number of frames that a paused world still runs. `events` are rates per second by
    type. `phases` are the durations of a frame's phases in microseconds, `bytes_in` and
    `bytes_out` its bytes; each is a mean over the last frames. `waiting` are the members for which
    the frame has waited `waited` seconds. `refused` counts rejected messages by class of sender:
    members, people, strangers. `late_frames` have taken longer than real time, by `behind` seconds
    in all. `series` is the number of collected series that can be shown. `norms` are those
    that were broken, and `files` what the world writes. `end` is the frame at which the replay of a
    record ends, 0 if this is not a replay; its record is then among the files. `people` are the
    event types that the world file lists for people.
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
    series: int = 0
    norms: tuple[NormStatus, ...] = ()
    files: tuple[FileStatus, ...] = ()
    end: int = 0
    people: tuple[str, ...] = ()

    @property
    def orders(self) -> tuple[str, ...]:
        """The event types that people may send: listed ones, and those a member takes; sorted."""
        taken = {order for member in self.members for order in member.orders}
        return tuple(sorted(taken.union(self.people)))

    @property
    def time(self) -> float:
        """Simulated seconds since the start of the world."""
        return self.frame * self.dt


class Operator(Protocol):
    """Interface to operate a running world; may be used from any thread.

    Every method raises BusError if the world does not answer or rejects the request.
    """

    def named(self, by: str) -> Operator:
        """The same operator, whose orders have the name of a person; "" leaves its own name."""
        ...

    def status(self, since: int = 0) -> WorldStatus:
        """The state of the world; `happenings` are the log entries after the number `since`."""
        ...

    def fragment(self, agent: str) -> str:
        """The text of an agent, including its scope."""
        ...

    def order(self, event: AnyEvent) -> int:
        """Send an event to the members that take orders for its type; returns its number."""
        ...

    def pause(self) -> None:
        """Start no further frame until `resume` or `step`."""
        ...

    def resume(self) -> None:
        """Resume a paused world."""
        ...

    def step(self, frames: int = 1) -> None:
        """Run a number of frames, then pause."""
        ...

    def seek(self, frame: int) -> None:
        """Continue the replay of a record at a frame."""
        ...

    def set_rate(self, rate: float) -> None:
        """Set the number of frames per second; 0 removes the limit."""
        ...

    def restart(self, member: str) -> None:
        """Restart a process of the world file."""
        ...

    def stack(self, member: str) -> None:
        """Write the stacks of a process of the world file to its log."""
        ...

    def drain(self, member: str) -> Sequence[str]:
        """Move the agents of a host to other hosts; returns these hosts."""
        ...

    def logs(self, since: int = 0, member: str = "") -> Sequence[LogLine]:
        """Log lines after the number `since`, of one member or of all."""
        ...

    def orders(self, since: int = 0) -> Sequence[OrderStatus]:
        """The last orders of people that have changed after the change of this number."""
        ...

    def series(self) -> Sequence[CollectedSeries]:
        """The collected series; worlds without any may not support the query."""
        ...


class NoOperator:
    """The operator of a world that cannot be operated: questions and orders raise MisuseError."""

    def named(self, by: str) -> NoOperator:
        """The same operator, since there are no orders to name."""
        return self

    def __getattr__(self, name: str) -> object:
        raise MisuseError("this world cannot be operated from here")
