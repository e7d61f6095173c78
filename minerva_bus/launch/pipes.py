"""The pipes from which the launcher hears its processes."""

from __future__ import annotations

import os
import select
import selectors
from collections.abc import Callable
from typing import Final

PIECE: Final = 65536
NOWHERE: Final = -1
"""In place of a descriptor that is closed: the system gives its number to another one."""


class Pipes:
    """Read ends of pipes that do not block, and what hears each of them."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def listen(self, descriptor: int, hear: Callable[[], object]) -> None:
        """Let `hear` be called whenever there is something to `read`, or the end of it."""
        self._selector.register(descriptor, selectors.EVENT_READ, hear)

    def wait(self, seconds: float) -> None:
        """Wait until there is something to hear, but no longer; hear it."""
        for key, _ in self._selector.select(seconds):
            # What was called for one may have read another to its end: its key is stale then.
            if self._selector.get_map().get(key.fd) is key:
                key.data()

    def wait_for(self, descriptor: int, seconds: float) -> bool:
        """Wait until one of them has something to `read`, and hear none; whether it has."""
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        return bool(poll.poll(1000 * seconds))

    def read(self, descriptor: int) -> bytes | None:
        """What there is to read, perhaps nothing; None, and closed, where no more will come."""
        try:
            data = os.read(descriptor, PIECE)
        except BlockingIOError:
            return b""
        if data:
            return data
        self.forget(descriptor)
        return None

    def forget(self, descriptor: int) -> None:
        """Close one, if it is not closed already."""
        if descriptor != NOWHERE:
            self._selector.unregister(descriptor)
            os.close(descriptor)

    def close(self) -> None:
        """Close them all."""
        for key in list(self._selector.get_map().values()):
            self.forget(key.fd)
        self._selector.close()
