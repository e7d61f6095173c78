"""State of a world between two frames that its string does not contain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from minerva_bus.frame.event_sources import AGENTS
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.norms import SOURCE

HALTED: Final = "~halted"
"""Key in `Checkpoint.saved` for the agents whose actions the last views must not execute."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """State beside the string between two frames; `frame` is the next one.

    `saved`: data saved by members in step in their last complete frame, by member.
    `emitted`: events that agents sent, and `inbox`: events from other sources, by source; both
    count in the next frame.
    `reached`: agents that reached the event of `until`; `reaching`: kinds that can reach it.
    """

    frame: int = 0
    saved: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    emitted: tuple[AnyEvent, ...] = ()
    inbox: Mapping[str, tuple[AnyEvent, ...]] = field(
        default_factory=dict[str, tuple[AnyEvent, ...]]
    )
    reached: frozenset[str] = frozenset()
    reaching: frozenset[str] = frozenset()

    @property
    def sent(self) -> dict[str, tuple[AnyEvent, ...]]:
        """What agents and norms sent in the frame before, by source: events of the next frame."""
        return {AGENTS: self.emitted, SOURCE: self.inbox.get(SOURCE, ())}
