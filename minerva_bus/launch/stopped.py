"""A coordinator that a signal has stopped (SIGSTOP) for good."""

from __future__ import annotations

from typing import Final

from minerva_bus.launch.machine import Machine

STOPPED_SECONDS: Final = 10.0
"""Time after which a stopped coordinator is killed.

Members without their coordinator end after their lease and BACK_WITHIN (8 s); some restarts later
the world would be given up.
"""

LATE_SECONDS: Final = 5.0
"""Interval between two looks of a launcher that was stopped as well, with all of its world."""


class StoppedCoordinator:
    """Measures for how long the coordinator has been stopped while the launcher was running."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._looked_at = 0.0
        self._pid = 0
        self._since = 0.0

    def is_given_up(self, pid: int, now: float) -> bool:
        """Whether to kill it; to be called at least once a second, with the monotonic time."""
        late = now - self._looked_at > LATE_SECONDS
        self._looked_at = now
        if late or pid != self._pid or not self._machine.is_stopped(pid):
            self._pid, self._since = pid, now
        return now - self._since >= STOPPED_SECONDS
