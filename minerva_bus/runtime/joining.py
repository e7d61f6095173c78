"""How a member joins its world, talks to it, and joins it again after a lost connection.

It finds the world, takes a name and is greeted. Zenoh reconnects by itself, to the address that the
host name resolves to at that time; the member's name is then reclaimed.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterable, Iterator
from math import inf
from typing import Any, Final, TypeAlias, cast

import zenoh

from minerva_bus.errors import BusError, ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.runtime.metrics import Restraint
from minerva_bus.runtime.session import REAL, System, Timer
from minerva_bus.runtime.transport import encode_reply, tick_in
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.codec import Decoder, encode, stamp, stamped
from minerva_bus.wire.keys import COORDINATOR, Keys
from minerva_bus.wording import duration

Call: TypeAlias = Callable[[], bool | None]
"""What a timer or a thread leaves to the main thread; False: the member takes part no more."""


# --- messages as bytes: with the current coordinator, and on sensor topics ---


class WorldLink:
    """Encodes and decodes the messages of one member.

    The current coordinator is the one of the highest epoch that has greeted, rejected or stopped
    this member. `stamp` is its epoch as bytes, empty before that. `unsent` counts events
    that no coordinator received.
    """

    def __init__(
        self, keys: Keys, member: str, notify: Callable[[str], None], clock: Callable[[], float]
    ) -> None:
        self.keys = keys
        self.stamp = b""
        self.unsent: int = 0
        self._member = member
        self._notify = notify
        self._clock = clock
        self._epoch = -1
        self._decoder = Decoder()
        self._joined = False
        self._restraint = Restraint()
        self._topics = f"{keys.base}/topic/"
        self._publishers: dict[str, zenoh.Publisher] = {}

    def open(self, session: zenoh.Session, topics: Iterable[str]) -> list[Any]:
        """Declare publishers for the coordinator and for topics; returns the declarations."""
        keys, member = self.keys, self._member
        self._replies = _publisher(session, keys.sent_by(member))
        for topic in topics:
            # Members of this process get readings without encoding.
            self._publishers[topic] = session.declare_publisher(
                keys.topic(topic, member),
                congestion_control=zenoh.CongestionControl.BLOCK,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        return [self._replies, *self._publishers.values()]

    def send(self, message: m.FromMember | m.Readings) -> None:
        """Send a message; before a coordinator's greeting it has no recipient and is dropped.

        Readings go to other processes, and are not even encoded if none subscribes to them.
        """
        if isinstance(message, m.Readings):
            publisher = self._publishers[message.topic]
            # The stub has another type.
            if cast("Any", publisher).matching_status.matching:
                publisher.put(encode(message))
        # Read once: a generator's thread sends, too, while the main thread may lose the connection.
        elif epoch := self.stamp:
            self._replies.put(epoch + encode_reply(message))
        else:
            # Only events are lost: replies belong to a frame that is requested again.
            self.unsent += isinstance(message, m.Emitted)

    def joined(self, vocabulary: Vocabulary) -> None:
        """Note that the member has joined: from now on messages may contain the world's symbols."""
        self._decoder, self._joined = Decoder(vocabulary), True

    def lost(self) -> None:
        """Note that the connection is lost: ignore coordinators until one greets again."""
        if self.stamp:
            # The same coordinator may greet again: its epoch must count as a later one then.
            self._epoch, self.stamp = self._epoch - 1, b""

    def message(self, data: bytes) -> m.ToMember | None:
        """The coordinator's message; None for one that must be ignored.

        Raises ProtocolError and SceneError for a message that cannot be decoded: a member that has
        missed one can no longer take part.
        """
        # The usual case, decided without decoding the epoch.
        if self.stamp and data.startswith(self.stamp):
            body = data[len(self.stamp) :]
        elif (body := self._first_of_epoch(data)) is None:
            return None
        try:
            return tick_in(body) or self._decoder.to_member(body)
        except (ProtocolError, SceneError):
            if self._joined:
                raise
            return None  # Without the vocabulary, messages with symbols cannot be decoded.

    def is_topic(self, key: str) -> bool:
        """Whether readings arrive on a key."""
        return key.startswith(self._topics)

    def readings(self, key: str, data: bytes) -> m.Readings | None:
        """The readings that arrived on the key of a topic; None if they cannot be decoded."""
        topic, publisher = key.split("/")[3:5]
        try:
            return self._decoder.readings(topic, publisher, data)
        except (ProtocolError, SceneError) as error:
            if self._joined:
                self._drop(publisher, str(error))
            return None

    def _first_of_epoch(self, data: bytes) -> bytes | None:
        """The message of a later coordinator without its epoch, if it concerns this member."""
        try:
            epoch, body = stamped(data)
            # A coordinator that has been replaced may still be sending,
            # for example after it was frozen.
            if epoch <= self._epoch:
                return None
            # Decoded before the epoch is accepted: bytes that are not a message
            # must not displace a coordinator.
            message = self._decoder.to_member(body)
        except (ProtocolError, SceneError):
            return None
        # Other messages concern a membership that this member does not have with that coordinator.
        if not isinstance(message, m.Greet | m.Refused | m.Stop):
            return None
        self._epoch, self.stamp = epoch, stamp(epoch)
        return body

    def _drop(self, publisher: str, error: str) -> None:
        """Report readings that cannot be read, at a limited rate per publisher."""
        now = self._clock()
        for who, text in self._restraint.left_out(now):
            self._notify(f"{self._member}: from {who}: {text}")
        if self._restraint.lets(publisher, now):
            self._notify(f"{self._member}: from {publisher}: {error}; dropped")


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)


# --- finding the world, and the greeting ---


@fast_dataclass
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


class GreetingTimer:
    """Calls `late` in a thread when the greeting is late."""

    def __init__(self, arrival: Arrival, system: System, late: Callable[[], None]) -> None:
        self._arrival = arrival
        self._system = system
        self._late = late
        self._since = 0.0
        self._timer: Timer | None = None

    def start(self) -> None:
        """Begin to wait."""
        self._since = self._system.monotonic()
        self.restart()

    def restart(self) -> None:
        """Wait for another interval."""
        if self._arrival.greeted < inf:
            self._timer = self._system.later(self._arrival.greeted, self._late)

    def cancel(self) -> None:
        """Stop waiting."""
        if self._timer is not None:
            self._timer.cancel()

    @property
    def expired(self) -> bool:
        """Whether even a busy coordinator would have greeted by now."""
        return self._system.monotonic() - self._since >= self._arrival.greeted_at_most


# --- a lost connection: duration, cause and time-out ---

QUIET_SECONDS: Final = 1.0
"""Seconds before the loss is reported: a killed coordinator has a successor by then."""

MAX_INTERVAL_SECONDS: Final = 60.0
"""Longest interval between two reports of the same loss."""


class ReconnectMonitor:
    """Monitors the connection to one world.

    `subject` begins each report. `patience` is the time-out in seconds. `obstacle` diagnoses the
    endpoint; it may block and runs in a thread. `put` passes calls of `check` and `diagnosed` to
    the main thread.
    """

    def __init__(
        self,
        subject: str,
        patience: float,
        obstacle: Callable[[], str],
        notify: Callable[[str], None],
        put: Callable[[Call], None],
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
            self._system.aside(self._diagnose)
        # Waiting for as long as the loss has lasted doubles the interval with each report.
        self._check_in(min(elapsed, MAX_INTERVAL_SECONDS, self.patience - elapsed))
        return True

    def _diagnose(self) -> None:
        obstacle = self._obstacle()
        self._put(lambda: self.diagnosed(obstacle))

    def diagnosed(self, obstacle: str) -> None:
        """Report the obstacle to the connection."""
        if self._since is not None:
            state = f"has been unreachable for {duration(self._elapsed())}"
            self._notify(f"{self._subject} {state}: {obstacle}; {self._outlook()}")

    def _outlook(self) -> str:
        return f"reconnecting for another {duration(max(0.0, self.patience - self._elapsed()))}"

    def _elapsed(self) -> float:
        return 0.0 if self._since is None else self._system.monotonic() - self._since

    def _check_in(self, seconds: float) -> None:
        self._timer = self._system.later(seconds, lambda: self._put(self.check))


# --- names: of several processes that find one free, one takes it ---


class NameClaim:
    """The liveliness token of a process that is about to take a member's name.

    A process declares its claim first and looks for others then, so of two processes at least the
    later one sees the other. The claim stays until the process has the name, whose own token shows
    that from then on.
    """

    def __init__(self, keys: Keys, member: str) -> None:
        self._own = keys.claim(member, secrets.token_hex(8))
        self._all = keys.claim(member)
        self._token: zenoh.LivelinessToken | None = None

    def granted(self, session: zenoh.Session) -> bool:
        """Claim the name; returns whether no other process does.

        Of several claims the smallest stays, and is granted once the others are withdrawn.
        """
        others = self._others(session)
        if self._token is None:
            if others:
                return False
            self._token = session.liveliness().declare_token(self._own)
            others = self._others(session)
        if others and min(others) < self._own:
            self.withdraw()
        return not others

    def withdraw(self) -> None:
        """Give up the claim."""
        if self._token is not None:
            self._token.undeclare()
            self._token = None

    def _others(self, session: zenoh.Session) -> list[str]:
        replies = session.liveliness().get(self._all, timeout=1.0)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return [key for key in keys if key != self._own]


NAME_FREE_AGAIN: Final = 4.0
"""Seconds within which the name of a member that has reconnected is free again."""

RECLAIM_SECONDS: Final = 0.1
"""Interval in seconds between two attempts to reclaim the name."""


STANDBY_SECONDS: Final = 5.0
"""Seconds after which a standby takes a name that nobody has: a member that has lost its link for a
moment, or is restarted, comes first."""


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
                    f"there is a member {self._name!r} in the world already; end it first, or"
                    " choose another name (--name; with keys, the certificate of another name)"
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
    """Releases and reclaims the name of `member`; `put` passes calls to the main thread."""

    def __init__(
        self,
        member: str,
        monitor: ReconnectMonitor,
        link: WorldLink,
        notify: Callable[[str], None],
        put: Callable[[Call], None],
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
            self._system.later(RECLAIM_SECONDS, lambda: self._put(lambda: self.reclaim(session)))
        else:
            raise BusError(
                f"the world {self._link.keys.world!r} is reachable again, but another member has"
                f" the name {self._member!r}; this one ends"
            )
