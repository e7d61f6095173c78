"""Time-outs of a joining member: for the world, its name and a greeting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any, Final

from minerva_bus.runtime.system import System, Timer


@dataclass(frozen=True, slots=True)
class Arrival:
    """Time-outs in seconds: to find the world, to get a free name, to be greeted.

    A busy coordinator has `greeted_at_most` seconds to greet. A `standby` first waits until the
    member of its name has gone. With `claims`, other processes may take the name at the same time.
    """

    seen: float = 1.0
    named: float = 2.0
    greeted: float = 10.0
    greeted_at_most: float = 60.0
    standby: bool = False
    claims: bool = False


ARRIVAL: Final = Arrival()
# Hundreds of processes may start at once, so the coordinator may be slow to greet them.
STARTED_HERE: Final = Arrival(60.0, 60.0, inf, inf)
"""For members started by the launcher: the world exists, and the launcher stops late members."""


@dataclass(frozen=True, slots=True)
class Ungreeted:
    """Timer: the member was not greeted before the time-out."""


class GreetingTimer:
    """Puts `Ungreeted` into the inbox when the greeting is late."""

    def __init__(self, arrival: Arrival, system: System, put: Callable[[Any], None]) -> None:
        self._arrival = arrival
        self._system = system
        self._put = put
        self._since = 0.0
        self._timer: Timer | None = None

    def start(self) -> None:
        """Begin to wait."""
        self._since = self._system.monotonic()
        self.restart()

    def restart(self) -> None:
        """Wait for another interval."""
        if self._arrival.greeted < inf:
            self._timer = self._system.later(self._arrival.greeted, lambda: self._put(Ungreeted()))

    def cancel(self) -> None:
        """Stop waiting."""
        if self._timer is not None:
            self._timer.cancel()

    @property
    def expired(self) -> bool:
        """Whether even a busy coordinator would have greeted by now."""
        return self._system.monotonic() - self._since >= self._arrival.greeted_at_most
