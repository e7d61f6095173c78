"""Monitors a member's lost connection to its world: duration, cause and time-out.

Zenoh reconnects by itself, to the address that the host name resolves to at that time. The monitor
informs the user and gives up after a time-out.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.runtime.system import REAL, System, Timer
from minerva_bus.wording import duration

QUIET_SECONDS: Final = 1.0
"""Seconds before the loss is reported: a killed coordinator has a successor by then."""

MAX_INTERVAL_SECONDS: Final = 60.0
"""Longest interval between two reports of the same loss."""


@dataclass(frozen=True, slots=True)
class CheckConnection:
    """Timer: check whether the world is back."""


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """The result of a diagnosis: the obstacle to the connection."""

    obstacle: str


class ReconnectMonitor:
    """Monitors the connection to one world.

    `subject` begins each report. `patience` is the time-out in seconds. `obstacle` diagnoses the
    endpoint; it may block and runs in a thread. `put` passes `CheckConnection` and `Diagnosed` to
    the main thread, which calls `check` and `diagnosed`.
    """

    def __init__(
        self,
        subject: str,
        patience: float,
        obstacle: Callable[[], str],
        notify: Callable[[str], None],
        put: Callable[[Any], None],
        system: System = REAL,
    ) -> None:
        self._system = system
        self._subject = subject
        self.patience = patience
        self._obstacle = obstacle
        self._notify = notify
        self._put = put
        self._since: float | None = None
        self._reported = False
        self._timer: Timer | None = None

    @property
    def away(self) -> bool:
        """Whether the connection is lost."""
        return self._since is not None

    def lost(self) -> None:
        """Note that the connection is lost."""
        self._since, self._reported = self._system.monotonic(), False
        self._check_in(min(QUIET_SECONDS, self.patience))

    def restored(self) -> None:
        """Note that the connection is restored."""
        if self._reported:
            self._notify(f"{self._subject} is reachable again after {duration(self._elapsed())}")
        self.close()

    def close(self) -> None:
        """Stop monitoring."""
        self._since = None
        if self._timer is not None:
            self._timer.cancel()

    def check(self) -> bool:
        """Report the loss, with exponential back-off; False after the time-out."""
        if self._since is None:
            return True
        elapsed = self._elapsed()
        if elapsed >= self.patience:
            self._notify(f"{self._subject} has been unreachable for {duration(elapsed)}; giving up")
            return False
        if not self._reported:
            self._reported = True
            since = time.strftime("%H:%M:%S", time.localtime(self._system.time() - elapsed))
            self._notify(f"{self._subject} has been unreachable since {since}; {self._outlook()}")
        else:
            # In a thread, because name resolution and connecting may block for seconds.
            self._system.aside(lambda: self._put(Diagnosed(self._obstacle())))
        # Waiting for as long as the loss has lasted doubles the interval with each report.
        self._check_in(min(elapsed, MAX_INTERVAL_SECONDS, self.patience - elapsed))
        return True

    def diagnosed(self, diagnosis: Diagnosed) -> None:
        """Report the obstacle to the connection."""
        if self._since is not None:
            state = f"has been unreachable for {duration(self._elapsed())}"
            self._notify(f"{self._subject} {state}: {diagnosis.obstacle}; {self._outlook()}")

    def _outlook(self) -> str:
        return f"reconnecting for another {duration(max(0.0, self.patience - self._elapsed()))}"

    def _elapsed(self) -> float:
        return 0.0 if self._since is None else self._system.monotonic() - self._since

    def _check_in(self, seconds: float) -> None:
        self._timer = self._system.later(seconds, lambda: self._put(CheckConnection()))
