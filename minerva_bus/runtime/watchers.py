"""The interface between a coordinator and the launcher: callbacks, and items of its inbox."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import zenoh

from minerva_bus.frame import stimuli as s
from minerva_bus.runtime.status import Status
from minerva_bus.world.operator import FileStatus, PersonOperation

if TYPE_CHECKING:
    from minerva_bus.collect.history import SeriesHistory


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
