"""One queue for everything that a process receives, in the order of arrival.

Threads of Zenoh deliver, the main thread receives. Delivery through a Python callback acquires the
interpreter lock for each message. The messages of a frame are therefore read from a channel that
Zenoh fills without the lock; everything else is put into a side queue and sends a wake-up.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import RLock
from typing import Any

import zenoh
from zenoh.handlers import Callback, FifoChannel

from minerva_bus.runtime.session import REAL, System, Timer
from minerva_bus.values import fast_dataclass

CAPACITY = 512
"""Messages that may wait for the coordinator's main thread; a reply waits behind all of them."""
MAX_WAKE_UPS = CAPACITY // 2
MEMBER_CAPACITY = 1 << 20
"""Messages that may wait for a member: if the channel of an observer that is busy drawing were full
of views, the link would be, too, and the coordinator would wait for it."""
MAX_SESSION_ID = 32
"""Bytes by which a question names the session that asks."""
WAKE_UP = b"\x00"
WAKE_UP_SECONDS = 1.0


@fast_dataclass
class TimerTick:
    """Periodic timer: time-outs and status are due."""


@fast_dataclass
class KeyedSample:
    """A message on a key, or whether the liveliness token of this key is `there`."""

    key: str
    data: bytes
    there: bool = True


def keyed_sample(sample: zenoh.Sample) -> KeyedSample:
    """A sample of Zenoh as plain data."""
    there = sample.kind == zenoh.SampleKind.PUT
    return KeyedSample(str(sample.key_expr), sample.payload.to_bytes(), there)


@fast_dataclass
class Question:
    """A question on a key; `reply` answers it once, on a key.

    `session` is what it says of the session that asks, so that questions of several can be told
    apart.
    """

    key: str
    session: bytes
    data: bytes
    reply: Callable[[str, bytes], None]


def question(query: zenoh.Query, most: int) -> Question:
    """A query as a `Question`; a payload of more than `most` bytes is left out."""

    def reply(key: str, data: bytes) -> None:
        with query:
            query.reply(key, data)

    payload, named = query.payload, query.attachment
    data = payload.to_bytes() if payload and len(payload) <= most else b""
    session = named.to_bytes() if named and len(named) <= MAX_SESSION_ID else b""
    return Question(str(query.key_expr), session, data, reply)


class Watch:
    """Queue of watchers, whose latency affects no frame."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Any] = SimpleQueue()

    def handler(self) -> Callback[Any]:
        """A handler for a Zenoh declaration that puts items into this queue.

        Direct, because a plain C `put` neither blocks nor computes.
        """
        return Callback(self._queue.put, indirect=False)

    def get(self, until: float) -> Any:
        """The next item, or None at the monotonic time `until`."""
        wait = until - time.monotonic()
        try:
            return self._queue.get(timeout=wait) if wait > 0 else self._queue.get_nowait()
        except Empty:
            return None


def _as_it_is(item: Any) -> Any:
    return item


def _nobody(sign: bytes) -> None:
    """Ignore a wake-up while no session is open."""


class Inbox:
    """Inbox of a member: messages of one key from a channel, everything else from a side queue.

    An item of the side queue wakes the main thread with a message to itself on the channel's key,
    so that one blocking receive sees everything in order.
    """

    indirect = False
    capacity = MEMBER_CAPACITY

    def __init__(self) -> None:
        self._side: SimpleQueue[Any] = SimpleQueue()
        self._wake: Callable[[bytes], None] = _nobody
        self._waking = RLock()  # Reentrant: a signal handler may put, too.
        self._unsent = 0
        self._aside_next = False

    def open(self, session: zenoh.Session, key: str, wake_key: str = "") -> list[Any]:
        """Subscribe to a key; returns the declarations to undeclare at the end.

        `wake_key` carries the wake-ups if the key itself has wildcards.
        """
        channel = session.declare_subscriber(key, FifoChannel(self.capacity))
        waker = session.declare_publisher(
            wake_key or key,
            congestion_control=zenoh.CongestionControl.BLOCK,
            # Wake-ups concern this process alone and must not use the link.
            allowed_destination=zenoh.Locality.SESSION_LOCAL,
        )

        def tell(sign: bytes) -> None:
            try:
                waker.put(sign)
            except zenoh.ZError:
                return  # The session is closing: no thread waits for this wake-up.

        self._channel, self._wake = channel, tell
        for _ in range(min(self._side.qsize(), MAX_WAKE_UPS)):
            tell(WAKE_UP)  # For earlier items.
        return [channel]

    def close(self) -> None:
        """Make sure that no wake-up is pending or will be requested.

        A thread that returns from Zenoh while the interpreter shuts down would abort the process.
        """
        alone = self._waking.acquire(timeout=WAKE_UP_SECONDS)
        self._wake = _nobody
        if alone:
            self._waking.release()

    def put(self, item: Any) -> None:
        """Add an item to the side queue; from any thread.

        Beyond MAX_WAKE_UPS items no further wake-up is sent yet: the channel would be full, and
        the calling thread of Zenoh would block.
        """
        # Together: a wake-up of another thread's item would take this one, whose own comes later,
        # perhaps after a message of the channel that was sent after this item.
        with self._waking:
            self._side.put(item)
            if self._side.qsize() <= MAX_WAKE_UPS:
                self._wake(WAKE_UP)

    def again(self, item: Any) -> None:
        """Add an item to the side queue, behind the next message; from the main thread only."""
        self._side.put(item)
        # Without a wake-up, which could block this thread: no other one empties the channel.
        self._unsent += 1

    def handler(self, read: Callable[[Any], Any] = _as_it_is) -> Callback[Any]:
        """A handler for a Zenoh declaration that puts into the side queue, in order of arrival.

        `read` converts each item; None is left out.
        """

        def put(item: Any) -> None:
            # A flood of what is not let in must not even wake the main thread.
            if (known := read(item)) is not None:
                self.put(known)

        return Callback(put, indirect=self.indirect)

    def early(self) -> Any:
        """The next item that was put before a session is open, if there is one."""
        return self._aside()

    def wait(self) -> Any:
        """The next item: a message of the channel as bytes, or one of the side queue.

        None for a wake-up without an item.
        """
        return self.ready() if self._unsent else self._read(self._channel.recv())

    def ready(self) -> Any:
        """The next item if there is one."""
        self._aside_next = not self._aside_next
        if self._unsent and self._aside_next:
            return self._take_unsent()
        sample = self._channel.try_recv()
        if sample is not None:
            return self._read(sample)
        return self._take_unsent() if self._unsent else None

    def _read(self, sample: zenoh.Sample) -> Any:
        data = sample.payload.to_bytes()
        return data if data != WAKE_UP else self._aside()

    def _take_unsent(self) -> Any:
        self._unsent -= 1
        return self._aside()

    def _aside(self) -> Any:
        try:
            item = self._side.get_nowait()
        except Empty:
            return None
        if self._side.qsize() >= MAX_WAKE_UPS:
            # For an item without a wake-up. This thread must not send one: the channel may be full,
            # and no other thread empties it.
            self._unsent += 1
        return item


class HubInbox(Inbox):
    """Inbox of the coordinator: messages of all members with their senders, by the channel.

    A timer sends wake-ups with an empty message.
    """

    indirect = True
    capacity = CAPACITY

    def __init__(self, every: float, system: System = REAL) -> None:
        super().__init__()
        self._every = every
        self._system = system
        self._clock: Timer | None = None

    def open(self, session: zenoh.Session, key: str, wake_key: str = "") -> list[Any]:
        """Subscribe to the members' keys; returns the declarations to undeclare at the end."""
        declared = super().open(session, key, wake_key)
        self._wake_key = wake_key
        self._sender = len(wake_key.rpartition("/")[0]) + 1
        self._clock = self._system.every(self._every, lambda: self._wake(b""))
        return declared

    def close(self) -> None:
        """Stop the timer and all wake-ups."""
        if self._clock is not None:
            self._clock.cancel()
        super().close()
        # The timer's thread may be in a wake-up now; it must have
        # returned before the interpreter ends.
        if self._clock is not None:
            self._clock.join()

    def _read(self, sample: zenoh.Sample) -> Any:
        """A member's name and its message, an item of the side queue, or a tick of the timer."""
        key, data = str(sample.key_expr), sample.payload.to_bytes()
        if key != self._wake_key:
            return key[self._sender :], data
        return self._aside() if data == WAKE_UP else TimerTick()
