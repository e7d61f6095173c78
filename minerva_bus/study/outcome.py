"""What a run of a world came to, for who judges it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from minerva_bus.grammar.scene import Scene


@dataclass(frozen=True, slots=True)
class Outcome:
    """A run's end: the final string and its digest, and what was counted on the way.

    `events` are how many there were of each type. `figures` are what members report at the end
    (`distance_driven`, ...). `reached`: every agent has sent the world's `until`.
    """

    scene: Scene
    frames: int
    digest: str
    ended: str
    reached: bool
    events: Mapping[str, int] = field(default_factory=dict[str, int])
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
