"""A member's name in its world, and its reclamation after a lost connection."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from minerva_bus.errors import BusError
from minerva_bus.runtime.name_claim import NameClaim
from minerva_bus.runtime.reconnect import ReconnectMonitor
from minerva_bus.runtime.system import System
from minerva_bus.runtime.world_link import WorldLink
from minerva_bus.wire.keys import COORDINATOR, Keys

NAME_FREE_AGAIN: Final = 4.0
"""Seconds within which the name of a member that has reconnected is free again."""

RECLAIM_SECONDS: Final = 0.1
"""Interval in seconds between two attempts to reclaim the name."""


STANDBY_SECONDS: Final = 5.0
"""Seconds after which a standby takes a name that nobody has: a member that has lost its link for a
moment, or is restarted, comes first."""


@dataclass(frozen=True, slots=True)
class ReclaimName:
    """Timer: check whether the member's name is free again."""


class NameToken:
    """The liveliness token that reserves a member's name.

    With `claims`, other processes may take the same name at the same time.
    """

    def __init__(self, name: str, keys: Keys, *, claims: bool = False) -> None:
        self._name = name
        self._key = keys.alive(name)
        self._claim = NameClaim(keys, name) if claims else None
        self._token: zenoh.LivelinessToken | None = None

    def until_free(
        self, session: zenoh.Session, clock: Callable[[], float], seconds: float
    ) -> Iterator[None]:
        """Wait until the name is free; yields before each further check.

        Raises BusError if another member has it for longer than `seconds`. The name of a member
        that has died is free after some milliseconds.
        """
        until = clock() + seconds
        while not self.is_ours(session):
            if clock() > until:
                raise BusError(
                    f"there is a member {self._name!r} in the world already;"
                    " choose another name (--name)"
                )
            yield

    def is_ours(self, session: zenoh.Session) -> bool:
        """Whether this process may reserve the name: nobody holds it, nor claims it before."""
        # In this order: a process that no longer claims the name holds it.
        granted = self._claim is None or self._claim.granted(session)
        return granted and not self.is_taken(session)

    def is_taken(self, session: zenoh.Session) -> bool:
        """Whether any session holds the name."""
        return bool(list(session.liveliness().get(self._key, timeout=1.0)))

    def declare(self, session: zenoh.Session) -> None:
        """Reserve the name."""
        self._token = session.liveliness().declare_token(self._key)
        self.withdraw()

    def withdraw(self) -> None:
        """Claim the name no more."""
        if self._claim is not None:
            self._claim.withdraw()

    def release(self) -> None:
        """Give up the name."""
        self.withdraw()
        if self._token is not None:
            self._token.undeclare()
            self._token = None


class Rejoin:
    """Releases and reclaims the name of `member`; `put` adds a `ReclaimName` to its inbox."""

    def __init__(
        self,
        member: str,
        monitor: ReconnectMonitor,
        link: WorldLink,
        notify: Callable[[str], None],
        put: Callable[[Any], None],
        system: System,
        *,
        claims: bool = False,
    ) -> None:
        self.name = NameToken(member, link.keys, claims=claims)
        self.monitor = monitor
        self._member = member
        self._link = link
        self._notify = notify
        self._put = put
        self._system = system
        self._since = 0.0
        self.losses: int = 0

    def lost(self) -> None:
        """The coordinator's token is gone: the world has ended, or the link is interrupted.

        Another member may take the name in between. So the member ignores coordinators until one
        greets it again, and reclaims its name only once that is free. `losses` counts the losses
        since the last greeting.
        """
        if not self.monitor.away:
            # The link has a stamp only while a coordinator has greeted the member.
            self.losses = 0 if self._link.stamp else self.losses + 1
            self.monitor.lost()
            self.name.release()
            self._link.lost()

    def stand_by(self, session: zenoh.Session) -> Iterator[None]:
        """Wait until the member of this name has gone; yields before each further check.

        Of several that stand by, one takes the name, and the others wait until that has gone.
        Raises BusError if the world is unreachable for longer than a member waits for it.
        """
        clock, world = self._system.monotonic, self._link.keys.alive(COORDINATOR)
        present = free = clock()
        while True:
            is_there = bool(list(session.liveliness().get(world, timeout=1.0)))
            # While a successor of the coordinator begins, no member has its name.
            if not is_there or self.name.is_taken(session):
                free = clock()
                self.name.withdraw()
            elif clock() >= free + STANDBY_SECONDS and self.name.is_ours(session):
                return
            if is_there:
                present = clock()
            elif clock() > present + self.monitor.patience:
                raise BusError(f"the world {self._link.keys.world!r} has ended")
            until = clock() + RECLAIM_SECONDS
            while clock() < until:
                yield

    def restored(self, session: zenoh.Session) -> None:
        """The coordinator's token is back."""
        if self.monitor.away:
            self._since = self._system.monotonic()
            self.reclaim(session)

    def reclaim(self, session: zenoh.Session) -> None:
        """Rejoin under the same name. Raises BusError if another member has it."""
        if not self.monitor.away:
            return
        # The hub may still hold the member's own former token, whose
        # link has not timed out there yet.
        if self.name.is_ours(session):
            self.name.declare(session)
            self.monitor.restored()
            # Events have no recipient while the link is lost, and a
            # generator cannot detect which were lost.
            if self._link.unsent:
                self._notify(f"{self._member}: {self._link.unsent} events were lost meanwhile")
                self._link.unsent = 0
        elif self._system.monotonic() < self._since + NAME_FREE_AGAIN:
            self._system.later(RECLAIM_SECONDS, lambda: self._put(ReclaimName()))
        else:
            raise BusError(
                f"the world {self._link.keys.world!r} is reachable again, but another member has"
                f" the name {self._member!r}; this one ends"
            )
