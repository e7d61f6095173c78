"""Lag: events across borders between parts of the string count some frames later.

The parts are a property of the world, as are the frames, so a world has the same string however
many coordinators run it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.scene import Scene

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class Lag(Protocol):
    """Which events count later, and by how much."""

    @property
    def frames(self) -> int:
        """The additional frames, at least 1."""
        ...

    def crossing(self, sent: Sequence[AnyEvent], before: Scene) -> list[NDArray[np.bool_]]:
        """For each event, or batch, of a frame, which of its rows cross a border.

        `before` is the string with which the frame began.
        """
        ...


def note_sent(algorithm: FrameAlgorithm, sent: Sequence[AnyEvent], before: Scene) -> None:
    """Queue what agents have sent in the frame that began with `before` and is complete now."""
    inbox, lag = algorithm.inbox, algorithm.world.lag
    if lag is None:
        inbox.emitted = [*sent]
        return
    near: list[AnyEvent] = []
    late: list[AnyEvent] = []
    for event, crosses in zip(sent, lag.crossing(sent, before) if sent else (), strict=True):
        near += _rows(event, ~crosses)
        late += _rows(event, crosses)
    inbox.postpone(algorithm.frame + lag.frames, late)
    # Older events first.
    inbox.emitted = [*inbox.take_postponed(algorithm.frame), *near]


def _rows(event: AnyEvent, rows: NDArray[np.bool_]) -> list[AnyEvent]:
    if rows.all():
        return [event]
    return [event.take(np.flatnonzero(rows))] if isinstance(event, Events) and rows.any() else []
