"""Health checks of a world, /live and /ready."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from minerva_bus.frame.phases import Phase
from minerva_bus.world.operator import WorldStatus

PATIENCE: Final = 2.0
"""Seconds that a frame may wait for a member while the world counts as ready."""


@dataclass(frozen=True, slots=True)
class Health:
    """The result of a health check, with a reason."""

    well: bool
    words: str

    @property
    def code(self) -> int:
        """The HTTP status: 200 or 503."""
        return 200 if self.well else 503


def live(status: WorldStatus | None, problem: str = "") -> Health:
    """Whether the coordinator answers; `status` is its answer, `problem` why there is none."""
    if status is None:
        return Health(False, f"the coordinator does not answer: {problem}")
    return Health(True, f"{status.world}: the coordinator answers")


def ready(status: WorldStatus | None, problem: str = "") -> Health:
    """Whether the world runs frames or could; a paused world is ready, too."""
    if status is None:
        return live(status, problem)
    names = ", ".join(status.waiting)
    if status.phase == Phase.WAITING.value:
        return Health(False, f"{status.world}: waits for {names or 'members'} to join")
    if status.waiting and status.waited >= PATIENCE:
        return Health(
            False,
            f"{status.world}: frame {status.frame} waits for {names} since {status.waited:.1f} s",
        )
    doing = "is paused before" if status.paused else "runs"
    return Health(True, f"{status.world}: {doing} frame {status.frame}")
