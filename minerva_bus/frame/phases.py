"""Phases of a world's life, and the literal table of their transitions."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Final


class Phase(Enum):
    """Phase of a world; status displays show the value."""

    WAITING = "gathering members"
    READY = "between frames"
    TICK = "events"
    EVOLVE = "evolution"
    CLOSING = "last view"
    STOPPING = "reports"
    ENDED = "over"

    # Enum's own hash is a Python function, and each frame looks up three transitions.
    __hash__ = object.__hash__


class Awaited(Enum):
    """Condition that ends a phase; the value is its label in the drawing."""

    MEMBERS = "expected members present"
    BEGIN = "Begin"
    EVENTS = "generators answered"
    RESULTS = "hosts answered"
    OVER = "world over"
    REPORTS = "members reported"
    END = "End or failure"

    __hash__ = object.__hash__  # As above.


TRANSITIONS: Final[Mapping[tuple[Phase, Awaited], Phase]] = {
    (Phase.WAITING, Awaited.MEMBERS): Phase.READY,
    (Phase.READY, Awaited.BEGIN): Phase.TICK,
    (Phase.TICK, Awaited.EVENTS): Phase.EVOLVE,
    (Phase.EVOLVE, Awaited.RESULTS): Phase.READY,
    (Phase.EVOLVE, Awaited.OVER): Phase.CLOSING,
    (Phase.CLOSING, Awaited.RESULTS): Phase.STOPPING,
    (Phase.STOPPING, Awaited.REPORTS): Phase.ENDED,
    # A coordinator may crash between the last frame and the last view, so its successor shows it.
    (Phase.WAITING, Awaited.OVER): Phase.CLOSING,
    # A replay ends between two frames when its last viewer leaves.
    (Phase.READY, Awaited.OVER): Phase.CLOSING,
    (Phase.WAITING, Awaited.END): Phase.STOPPING,
    (Phase.READY, Awaited.END): Phase.STOPPING,
    (Phase.TICK, Awaited.END): Phase.STOPPING,
    (Phase.EVOLVE, Awaited.END): Phase.STOPPING,
    (Phase.CLOSING, Awaited.END): Phase.STOPPING,
    # A second interrupt does not wait for reports.
    (Phase.STOPPING, Awaited.END): Phase.ENDED,
}
