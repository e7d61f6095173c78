"""What the coordinator tells others, and what is put to it, beside its messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

import zenoh

from minerva_bus.frame import stimuli as s
from minerva_bus.runtime.status import Status


@dataclass(frozen=True, slots=True)
class Printed:
    """A line that a member's process has printed, or the launcher has said of it."""

    member: str
    line: str
    level: str = "info"


@dataclass(frozen=True, slots=True)
class Started:
    """The launcher starts a member's process now."""

    member: str


@dataclass(frozen=True, slots=True)
class LocalQuestion:
    """A question from another thread of this process, and the future of its answer."""

    question: Mapping[str, Any]
    answer: Future[Mapping[str, Any]] = field(default_factory=Future[Mapping[str, Any]])


@dataclass(slots=True, kw_only=True)
class Watchers:
    """Whom the coordinator tells what happens; each is called in its main thread."""

    said: Callable[[str, str, str], None]
    """About which member, what, and details that are for the log."""
    status: Callable[[Status], None]
    listening: Callable[[str], None]
    stalled: Callable[[str, float], None]
    came: Callable[[str], None] = field(default=lambda _: None)
    """A member whose process the launcher has started has said hello."""
    frame_done: Callable[[s.FrameDone], None] = field(default=lambda _: None)
    idle: Callable[[], None] = field(default=lambda: None)
    """The coordinator goes to wait for others: it has time for what need not be done at once."""
    operated: Callable[[], None] = field(default=lambda: None)
    stopping: Callable[[str], None] = field(default=lambda _: None)
    """No frame follows, and why."""
    restart: Callable[[str], str] = field(default=lambda _: "its processes are not ours to restart")
    opened: Callable[[zenoh.Session], list[Any]] = field(default=lambda _: list[Any]())
    """What else is declared on the hub's session."""
