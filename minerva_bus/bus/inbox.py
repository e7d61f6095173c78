"""What a process hears, in one place and in the order in which it arrives.

Zenoh's threads hand over, the main thread takes. A hand-over through a Python callback costs a
turn of the interpreter's lock for each message, which a member with one message a frame can
afford; the coordinator, which hears everybody, reads its members' messages from a channel that
fills without the lock.
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import Any

import zenoh
from zenoh.handlers import Callback, FifoChannel

CAPACITY = 4096
KNOCK = b"\x00"


class Inbox:
    """One queue for all that a member hears."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Any] = SimpleQueue()
        self.put = self._queue.put

    def handler(self) -> Callback[Any]:
        """A handler for a Zenoh declaration that leads here.

        Direct, because a bare C put neither blocks nor computes; only the main thread does.
        """
        return Callback(self.put, indirect=False)

    def get(self, until: float | None = None) -> Any:
        """The next item, or None when the monotonic time `until` has come."""
        if until is None:
            return self._queue.get()
        wait = until - time.monotonic()
        try:
            return self._queue.get(timeout=wait) if wait > 0 else self._queue.get_nowait()
        except Empty:
            return None


def _nobody(sign: bytes) -> None:
    """Nobody is there to be knocked for."""


class HubInbox:
    """What the coordinator hears: members' messages by a channel, all else beside it.

    Whatever comes from the side knocks by a message on a key of its own, so that the one blocking
    receive sees everything, and each in its turn: a member's last words before its departure. A
    clock knocks too, with an empty message.
    """

    def __init__(self, every: float) -> None:
        self._side: SimpleQueue[Any] = SimpleQueue()
        self._every = every
        self._stop = Event()
        self._knock: Callable[[bytes], None] = _nobody
        self._clock = Thread(target=self._tick, daemon=True)

    def open(self, session: zenoh.Session, members: str, knock: str) -> list[Any]:
        """Begin to hear the members' keys; the declarations, to be undeclared at the end."""
        self._channel = session.declare_subscriber(members, FifoChannel(CAPACITY))
        knocking = session.declare_publisher(knock)
        self._knock = lambda sign: knocking.put(sign)
        self._clock.start()
        return [self._channel]

    def close(self) -> None:
        """Stop the clock; nobody knocks any more."""
        self._stop.set()
        self._knock = _nobody
        self._clock.join()

    def put(self, item: Any) -> None:
        """Add an item from the side; from any thread."""
        self._side.put(item)
        self._knock(KNOCK)

    def handler(self) -> Callback[Any]:
        """A handler for a Zenoh declaration that leads here from the side."""
        return Callback(self.put, indirect=True)

    def wait(self) -> zenoh.Sample:
        """The next message; KNOCK stands for an item from the side, an empty one for the clock."""
        return self._channel.recv()

    def ready(self) -> zenoh.Sample | None:
        """The next message if there is one."""
        return self._channel.try_recv()

    def aside(self) -> Any:
        """The next item from the side, or None."""
        try:
            return self._side.get_nowait()
        except Empty:
            return None

    def _tick(self) -> None:
        while not self._stop.wait(self._every):
            self._knock(b"")
