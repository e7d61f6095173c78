"""What a region needs of the runner of its frame algorithm, wherever its members are."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member import Member
from minerva_bus.runtime.direct import Deliver
from minerva_bus.runtime.runner import Notice


class RegionRunner(Protocol):
    """Runs the frame algorithm of a region; its members are in this process, or elsewhere."""

    @property
    def ended(self) -> s.Ended | None:
        """The end of the world, when all members have reported."""
        ...

    def start(self) -> None:
        """Let members join."""
        ...

    def outlook(self, member: str) -> str:
        """What follows if a frame waits for a member any longer, and when; empty: nothing."""
        ...

    def handle(self, stimulus: s.Stimulus) -> None:
        """Process a stimulus; members elsewhere answer later."""
        ...


class MakeRunner(Protocol):
    """Makes the runner of an algorithm with the members of this process."""

    def __call__(
        self,
        algorithm: FrameAlgorithm,
        members: Iterable[Member],
        observe: Callable[[Notice], None],
        /,
        *,
        deliver: Deliver,
    ) -> RegionRunner:
        """Make a runner."""
        ...
