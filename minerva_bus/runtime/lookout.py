"""A world that is out of a member's sight: since when, why, and for how long it is looked for.

Zenoh makes the link anew by itself, to whatever address the endpoint's name has by then. What is
left to do is to say what happens, and to know when to give up.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.runtime.system import REAL, System, Timer

UNSAID: Final = 1.0
"""Seconds for which nothing is said: a coordinator that was killed has a successor by then."""

SELDOM: Final = 60.0
"""Seconds after which something is said again, at the latest."""


@dataclass(frozen=True, slots=True)
class Look:
    """It is time to see whether the world is back."""


@dataclass(frozen=True, slots=True)
class Looked:
    """What is in the way to the world."""

    obstacle: str


class Lookout:
    """Looks out for one world.

    `subject` is of whom it speaks; `patience` are the seconds after which it gives up; `obstacle`
    says what is in the way, and may take its time: it is called in a thread of its own. `put`
    hands `Look` and `Looked` to whoever calls `look` and `looked`.
    """

    def __init__(
        self,
        subject: str,
        patience: float,
        obstacle: Callable[[], str],
        tell: Callable[[str], None],
        put: Callable[[Any], None],
        system: System = REAL,
    ) -> None:
        self._system = system
        self._subject = subject
        self._patience = patience
        self._obstacle = obstacle
        self._tell = tell
        self._put = put
        self._since: float | None = None
        self._said = False
        self._timer: Timer | None = None

    @property
    def away(self) -> bool:
        """Whether the world is out of sight."""
        return self._since is not None

    def lost(self) -> None:
        """The world is out of sight from now on."""
        self._since, self._said = self._system.monotonic(), False
        self._look_in(min(UNSAID, self._patience))

    def found(self) -> None:
        """The world is back."""
        if self._said:
            self._tell(f"{self._subject} is back after {_spoken(self._passed())}")
        self.close()

    def close(self) -> None:
        """Look no more."""
        self._since = None
        if self._timer is not None:
            self._timer.cancel()

    def look(self) -> bool:
        """Say how it stands; False when it is time to give up."""
        if self._since is None:
            return True
        passed = self._passed()
        if passed >= self._patience:
            self._tell(f"{self._subject} is gone: it was out of sight for {_spoken(passed)}")
            return False
        if not self._said:
            self._said = True
            since = time.strftime("%H:%M:%S", time.localtime(self._system.time() - passed))
            self._tell(f"{self._subject} cannot be seen since {since}; {self._outlook()}")
        else:
            self._system.aside(self._see)
        self._look_in(min(passed, SELDOM, self._patience - passed))
        return True

    def looked(self, seen: Looked) -> None:
        """Say what is in the way."""
        if self._since is not None:
            passed = f"has been out of sight for {_spoken(self._passed())}"
            self._tell(f"{self._subject} {passed}: {seen.obstacle}; {self._outlook()}")

    def _see(self) -> None:
        self._put(Looked(self._obstacle()))

    def _outlook(self) -> str:
        left = max(0.0, self._patience - self._passed())
        return f"it may come back within {_spoken(left)}"

    def _passed(self) -> float:
        return 0.0 if self._since is None else self._system.monotonic() - self._since

    def _look_in(self, seconds: float) -> None:
        self._timer = self._system.later(seconds, lambda: self._put(Look()))


def _spoken(seconds: float) -> str:
    """Some time, as people say it."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
