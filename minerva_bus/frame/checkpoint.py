"""What a world needs beside its string to go on as if it had never stopped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.scene import Scene

HALTED: Final = "~halted"
"""The name under which a checkpoint keeps which agents carry out nothing of the last views."""


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Where a world stands between two frames, beside its string; `frame` is the next one.

    `saved` is what lockstep members saved in their last whole frame, by member; `emitted` what
    agents have sent, and `inbox` what has come from others, by source, for the next frame. Of
    `until`: the agents that have `reached` it, and the kinds of those that do, `reaching`.
    """

    frame: int = 0
    saved: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    emitted: tuple[AnyEvent, ...] = ()
    inbox: Mapping[str, tuple[AnyEvent, ...]] = field(
        default_factory=dict[str, tuple[AnyEvent, ...]]
    )
    reached: frozenset[str] = frozenset()
    reaching: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class LastView:
    """What was shown last of a visual event type: in which frame, and the string of L(E).

    The agents `halted` carried out nothing of it.
    """

    frame: int
    scene: Scene
    halted: tuple[str, ...] = ()
