"""What a process hears, in one place and in the order in which it arrives.

Zenoh's threads hand over, the main thread takes. A hand-over through a Python callback costs a
turn of the interpreter's lock for each message. So the messages of a frame, which are what counts,
are read from a channel that fills without the lock; all else is put beside it, and knocks.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from threading import RLock
from typing import Any

import zenoh
from zenoh.handlers import Callback, FifoChannel

from minerva_bus.runtime.system import REAL, System, Timer

CAPACITY = 4096
KNOCKS = CAPACITY // 2
KNOCK = b"\x00"
KNOCKED_WITHIN = 1.0


@dataclass(frozen=True, slots=True)
class Tick:
    """It is time to look at the clock."""


@dataclass(frozen=True, slots=True)
class Heard:
    """What came on a key, or whether the token of this key is `there`."""

    key: str
    data: bytes
    there: bool = True


def heard(sample: zenoh.Sample) -> Heard:
    """What a sample says."""
    there = sample.kind == zenoh.SampleKind.PUT
    return Heard(str(sample.key_expr), sample.payload.to_bytes(), there)


@dataclass(frozen=True, slots=True)
class Question:
    """Somebody asks on a key; `reply` answers, on a key, and once."""

    key: str
    data: bytes
    reply: Callable[[str, bytes], None]


def question(query: zenoh.Query) -> Question:
    """What a query asks."""

    def reply(key: str, data: bytes) -> None:
        with query:
            query.reply(key, data)

    data = query.payload.to_bytes() if query.payload else b""
    return Question(str(query.key_expr), data, reply)


class Watch:
    """One queue for what a watcher hears: nobody waits for it, so it may take its time."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Any] = SimpleQueue()

    def handler(self) -> Callback[Any]:
        """A handler for a Zenoh declaration that leads here.

        Direct, because a bare C put neither blocks nor computes; only the main thread does.
        """
        return Callback(self._queue.put, indirect=False)

    def get(self, until: float) -> Any:
        """The next item, or None when the monotonic time `until` has come."""
        wait = until - time.monotonic()
        try:
            return self._queue.get(timeout=wait) if wait > 0 else self._queue.get_nowait()
        except Empty:
            return None


def _as_it_is(item: Any) -> Any:
    return item


def _nobody(sign: bytes) -> None:
    """Nobody is there to be knocked for."""


class Inbox:
    """What a member hears: one key's messages by a channel, all else beside it.

    Whatever comes from the side knocks, by a message to itself on the channel's key, so that the
    one blocking receive sees everything, and each in its turn.
    """

    indirect = False

    def __init__(self) -> None:
        self._side: SimpleQueue[Any] = SimpleQueue()
        self._knock: Callable[[bytes], None] = _nobody
        self._knocking = RLock()  # A signal's handler may put, too.

    def open(self, session: zenoh.Session, key: str, knock: str = "") -> list[Any]:
        """Begin to hear a key; the declarations, to be undeclared at the end.

        `knock` is a key to knock on, where the key itself has wildcards.
        """
        channel = session.declare_subscriber(key, FifoChannel(CAPACITY))
        knocking = session.declare_publisher(
            knock or key,
            congestion_control=zenoh.CongestionControl.BLOCK,
            allowed_destination=zenoh.Locality.SESSION_LOCAL,
        )

        def tell(sign: bytes) -> None:
            try:
                knocking.put(sign)
            except zenoh.ZError:
                return  # The session is closing: nobody waits any more.

        self._channel, self._knock = channel, tell
        for _ in range(min(self._side.qsize(), KNOCKS)):
            tell(KNOCK)  # For what has come before.
        return [channel]

    def close(self) -> None:
        """Nobody knocks any more, and nobody is about to.

        A thread that comes back from Zenoh when the interpreter has begun to end would abort the
        process.
        """
        alone = self._knocking.acquire(timeout=KNOCKED_WITHIN)
        self._knock = _nobody
        if alone:
            self._knocking.release()

    def put(self, item: Any) -> None:
        """Add an item from the side; from any thread.

        One that lies behind very many others does not knock yet, or the channel would be full and
        Zenoh's thread would wait.
        """
        self._side.put(item)
        if self._side.qsize() <= KNOCKS:
            with self._knocking:
                self._knock(KNOCK)

    def handler(self, read: Callable[[Any], Any] = _as_it_is) -> Callback[Any]:
        """A handler for a Zenoh declaration that leads here from the side, in order of arrival.

        `read` makes something else of what comes.
        """

        def put(item: Any) -> None:
            self.put(read(item))

        return Callback(put, indirect=self.indirect)

    def wait(self) -> Any:
        """The next item: a message of the channel's as bytes, or one from the side.

        None where somebody knocked in vain.
        """
        data = self._channel.recv().payload.to_bytes()
        return data if data != KNOCK else self._aside()

    def ready(self) -> Any:
        """The next item if there is one."""
        sample = self._channel.try_recv()
        if sample is None:
            return None
        data = sample.payload.to_bytes()
        return data if data != KNOCK else self._aside()

    def _aside(self) -> Any:
        try:
            item = self._side.get_nowait()
        except Empty:
            return None
        if self._side.qsize() >= KNOCKS:
            self._knock(KNOCK)  # For one that has not knocked itself.
        return item


class HubInbox(Inbox):
    """What the coordinator hears: its members' messages by the channel, each with who sent it.

    A clock knocks too, with an empty message.
    """

    indirect = True

    def __init__(self, every: float, system: System = REAL) -> None:
        super().__init__()
        self._every = every
        self._system = system
        self._clock: Timer | None = None

    def open(self, session: zenoh.Session, key: str, knock: str = "") -> list[Any]:
        """Begin to hear the members' keys; the declarations, to be undeclared at the end."""
        declared = super().open(session, key, knock)
        self._knocked = knock
        self._sender = len(knock.rpartition("/")[0]) + 1
        self._clock = self._system.every(self._every, lambda: self._knock(b""))
        return declared

    def close(self) -> None:
        """Stop the clock; nobody knocks any more."""
        if self._clock is not None:
            self._clock.cancel()
        super().close()
        if self._clock is not None:
            self._clock.join()

    def wait(self) -> Any:
        """The next item: a member's name and its message, one from the side, or a `Tick`."""
        return self._read(self._channel.recv())

    def ready(self) -> Any:
        """The next item if there is one."""
        sample = self._channel.try_recv()
        return None if sample is None else self._read(sample)

    def _read(self, sample: zenoh.Sample) -> Any:
        key, data = str(sample.key_expr), sample.payload.to_bytes()
        if key != self._knocked:
            return key[self._sender :], data
        return self._aside() if data == KNOCK else Tick()
