"""Metrics of a running world's state: frame rate, members, waiting times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.pace import Pace
from minerva_bus.runtime.runner import Sink

SMOOTHING: Final = 0.3
"""Weight of the last interval in the frame rate."""


@dataclass(frozen=True, slots=True)
class Status:
    """State of a running world; `rate` is in frames per second, `waited` in seconds."""

    frame: int
    rate: float
    members: int
    phase: str
    paused: bool = False
    waiting: tuple[str, ...] = ()
    waited: float = 0.0


class StatusMeter(Sink):
    """Frame rate and number of members. `waited` is the waiting time of the current step."""

    def __init__(self, algorithm: FrameAlgorithm, pace: Pace, now: float) -> None:
        self.hz = 0.0
        self.waited = 0.0
        self.most_members = 0
        self.at = now
        self._frame: int = 0
        self._algorithm = algorithm
        self._pace = pace

    def status(self, now: float, waiting: Sequence[str]) -> Status:
        """The status at a monotonic time; the rate is that since the last one."""
        algorithm, paused = self._algorithm, self._pace.paused
        rate = (algorithm.frame - self._frame) / max(now - self.at, 1e-9)
        # A paused world has no frames, which an average would show only after a while.
        self.hz = rate if paused else self.hz + SMOOTHING * (rate - self.hz)
        self.at, self._frame = now, algorithm.frame
        active = len(algorithm.members.active())
        self.most_members = max(self.most_members, active)
        phase = algorithm.phase.value
        return Status(algorithm.frame, rate, active, phase, paused, tuple(waiting), self.waited)

    def ready(self, notice: s.Ready) -> None:
        """Count the members at the beginning of the world."""
        if notice.frame == 0:
            self.most_members = len(self._algorithm.members.active())
