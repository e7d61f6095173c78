"""Children of the launcher that a signal has stopped (SIGSTOP) for good."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

from minerva_bus.launch.machine import Machine

STOPPED_SECONDS: Final = 10.0
"""Time after which a stopped coordinator or region is killed.

Members without their coordinator end after their lease and BACK_WITHIN (8 s); some restarts later
the world would be given up.
"""

LATE_SECONDS: Final = 5.0
"""Interval between two looks of a launcher that was stopped as well, with all of its world."""


class StoppedChildren:
    """Measures for how long children have been stopped while the launcher was running."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._looked_at = 0.0
        self._since: dict[int, float] = {}

    def given_up(self, children: Collection[int], now: float) -> list[int]:
        """The process ids to kill; to be called at least once a second, with the monotonic time."""
        if now - self._looked_at > LATE_SECONDS:
            self._since.clear()
        self._looked_at = now
        stopped = [pid for pid in children if self._machine.is_stopped(pid)]
        self._since = {pid: self._since.get(pid, now) for pid in stopped}
        return [pid for pid in stopped if now - self._since[pid] >= STOPPED_SECONDS]
