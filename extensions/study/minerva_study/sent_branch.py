"""A branch point that is sent to the workers of an executor, with the world that continues there.

The frame itself is sent, so that workers need not have the record.
"""

from __future__ import annotations

from dataclasses import dataclass

from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.world_settings import Overrides
from minerva_study.branch_point import BranchPoint
from minerva_study.sent_world import SentWorld


@dataclass(frozen=True)
class SentBranch:
    """Calling it reads the world that continues at `point`; its code is that of `world`."""

    world: SentWorld
    point: BranchPoint

    @staticmethod
    def of(world: SentWorld, point: BranchPoint) -> SentBranch:
        """The point without what only this process has."""
        return SentBranch(world, point.with_world(world))

    def __call__(self, overrides: Overrides) -> WorldFile:
        """Read the world of a branch. Raises MinervaError."""
        return self.point(overrides)

    def check(self) -> None:
        """Check in a worker that it has the same code. Raises MinervaError."""
        self.world.check()
