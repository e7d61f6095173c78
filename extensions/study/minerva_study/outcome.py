"""The result of a run, as a fitness function receives it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from minerva_bus.grammar.scene import Scene


@dataclass(frozen=True, slots=True)
class Outcome:
    """The final string of a run with its digest, and statistics.

    `events`: number of events by type. `figures`: final reports of members (`distance_driven`,
    ...). `reached`: every agent has sent the world's `until`.
    """

    scene: Scene
    frames: int
    digest: str
    ended: str
    reached: bool
    events: Mapping[str, int] = field(default_factory=dict[str, int])
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
