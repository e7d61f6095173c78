"""A member that has lost its world: it gives up its name, and claims it when the world is back."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import zenoh

from minerva_bus.errors import BusError
from minerva_bus.runtime.name import Name
from minerva_bus.runtime.notices import Claim
from minerva_bus.runtime.reconnect import ReconnectMonitor
from minerva_bus.runtime.system import System
from minerva_bus.runtime.world_link import WorldLink

NAME_FREE_AGAIN: Final = 4.0
"""Seconds within which the name of a member that has reconnected is free again."""

CLAIMED_EVERY: Final = 0.1
"""Seconds between two attempts to claim the name."""


class Rejoin:
    """Gives up and reclaims the name of `member`; `put` adds a `Claim` to its inbox."""

    def __init__(
        self,
        member: str,
        name: Name,
        monitor: ReconnectMonitor,
        link: WorldLink,
        notify: Callable[[str], None],
        put: Callable[[Any], None],
        system: System,
    ) -> None:
        self.name = name
        self.monitor = monitor
        self._member = member
        self._link = link
        self._notify = notify
        self._put = put
        self._system = system
        self._since = 0.0

    def lost(self) -> None:
        """The coordinator's token is gone: the world has ended, or the link is interrupted.

        Messages of a coordinator do not count until it greets again: another member may have taken
        the name. The member therefore claims its name when it is free, and not before.
        """
        if not self.monitor.away:
            self.monitor.lost()
            self.name.give_back()
            self._link.lost()

    def found(self, session: zenoh.Session) -> None:
        """The coordinator's token is there."""
        if self.monitor.away:
            self._since = self._system.monotonic()
            self.claim(session)

    def claim(self, session: zenoh.Session) -> None:
        """Take part again under the same name. Raises BusError where another member has it."""
        if not self.monitor.away:
            return
        if not self.name.taken(session):
            self.name.take(session)
            self.monitor.found()
            if self._link.unsent:
                self._notify(f"{self._member}: {self._link.unsent} events of it were not heard")
                self._link.unsent = 0
        elif self._system.monotonic() < self._since + NAME_FREE_AGAIN:
            self._system.later(CLAIMED_EVERY, lambda: self._put(Claim()))
        else:
            raise BusError(
                f"the world {self._link.keys.world!r} is back, but there is another"
                f" {self._member!r} in it by now: this one ends"
            )
