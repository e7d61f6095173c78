"""What a coordinator reports to its launcher: callbacks, its status, and items of its inbox."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import zenoh

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.pace import Pace
from minerva_bus.frame.world_state import WorldProgress
from minerva_bus.runtime.runner import Sink
from minerva_bus.world.operator import FileStatus, PersonOperation

if TYPE_CHECKING:
    from minerva_bus.collect.collector import SeriesHistory


SMOOTHING: Final = 0.3
"""Weight of the last interval in the frame rate."""


@dataclass(frozen=True, slots=True)
class Status:
    """State of a running world; `rate` is in frames per second, `waited` in seconds."""

    frame: int
    rate: float
    members: int
    phase: str
    paused: bool = False
    waiting: tuple[str, ...] = ()
    waited: float = 0.0


class StatusMeter(Sink):
    """Frame rate and number of members. `waited` is the waiting time of the current step."""

    def __init__(self, algorithm: WorldProgress, pace: Pace, now: float) -> None:
        self.hz = 0.0
        self.waited = 0.0
        self.most_members = 0
        self.at = now
        self._frame: int = 0
        self._algorithm = algorithm
        self._pace = pace

    def status(self, now: float, waiting: Sequence[str]) -> Status:
        """The status at a monotonic time; the rate is that since the last one."""
        algorithm, paused = self._algorithm, self._pace.paused
        rate = (algorithm.frame - self._frame) / max(now - self.at, 1e-9)
        # A paused world has no frames, which an average would show only after a while.
        self.hz = rate if paused else self.hz + SMOOTHING * (rate - self.hz)
        self.at, self._frame = now, algorithm.frame
        active = len(algorithm.members.active())
        self.most_members = max(self.most_members, active)
        phase = algorithm.phase.value
        return Status(algorithm.frame, rate, active, phase, paused, tuple(waiting), self.waited)

    def ready(self, notice: s.Ready) -> None:
        """Count the members at the beginning of the world."""
        if notice.frame == 0:
            self.most_members = len(self._algorithm.members.active())


@dataclass(frozen=True, slots=True)
class Printed:
    """A line that a member's process printed, or that the launcher logged about it."""

    member: str
    line: str
    level: str = "info"


@dataclass(frozen=True, slots=True)
class Started:
    """The launcher starts a member's process."""

    member: str


@dataclass(frozen=True, slots=True)
class LocalQuestion:
    """A question from another thread of this process, and the future of its answer."""

    question: Mapping[str, Any]
    answer: Future[Mapping[str, Any]] = field(default_factory=Future[Mapping[str, Any]])


@dataclass(slots=True, kw_only=True)
class Watchers:
    """Callbacks of a coordinator; it calls them in its main thread."""

    said: Callable[[str, str, str], None]
    """A warning: member, text, and details for the log only."""
    status: Callable[[Status], None]
    listening: Callable[[str], None]
    stalled: Callable[[str, float], None]
    came: Callable[[str], None] = field(default=lambda _: None)
    """A member whose process the launcher has started sent its `hello`."""
    frame_done: Callable[[s.FrameDone], None] = field(default=lambda _: None)
    idle: Callable[[], None] = field(default=lambda: None)
    """The coordinator is about to wait for members: deferred work may be done."""
    operated: Callable[[], None] = field(default=lambda: None)
    """Events wait for a frame, or belong to it, which only this coordinator knows."""
    stopping: Callable[[s.Stopping], None] = field(default=lambda _: None)
    """No frame follows."""
    restart: Callable[[str], str] = field(default=lambda _: "no launcher restarts its processes")
    stack: Callable[[str], str] = field(default=lambda _: "no launcher started its processes")
    noted: Callable[[PersonOperation], None] = field(default=lambda _: None)
    """A person has operated the world."""
    opened: Callable[[zenoh.Session], list[Any]] = field(default=lambda _: list[Any]())
    """Returns further declarations on the hub's session."""
    files: Callable[[], tuple[FileStatus, ...]] = field(default=lambda: ())
    """What the launcher writes in this process: the record and the journal."""
    collected: SeriesHistory | None = None
    """Collected series, for dashboards."""
