"""Messages that no frame waits for, beyond the time that the coordinator spends on them at once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

AT_ONCE: Final = 0.01
"""Seconds that the coordinator spends on such messages before replies come first."""

SHARE: Final = 0.25
"""Share of the time that it spends on them while replies or further messages arrive."""

MOST: Final = 10_000
"""Messages that may be postponed; further ones are dropped."""

MOST_BYTES: Final = 64 << 20
"""Bytes of postponed messages above which further ones are dropped."""


@dataclass(frozen=True, slots=True)
class PostponedMessage:
    """The bytes of a member's message; `joins` counts how often the member had joined."""

    member: str
    joins: int
    data: bytes


class Postponed:
    """A queue of messages, and the time left for them.

    A reply waits behind all messages that arrived before it. So these are decoded only for AT_ONCE
    seconds and for SHARE of the time after that; the rest waits until nothing else has arrived.
    `process` decodes a message.
    """

    def __init__(
        self, process: Callable[[PostponedMessage], None], clock: Callable[[], float]
    ) -> None:
        self._process = process
        self._clock = clock
        self._queue: deque[PostponedMessage] = deque()
        self._bytes = 0
        self._left = AT_ONCE
        self._at = clock()

    def __bool__(self) -> bool:
        return bool(self._queue)

    def add(self, message: PostponedMessage) -> bool:
        """Process a message after all earlier ones, now if time is left; False if it is dropped."""
        if len(self._queue) >= MOST or self._bytes >= MOST_BYTES:
            return False
        self._queue.append(message)
        self._bytes += len(message.data)
        self._refill()
        while self._queue and self._left > 0:
            self.process_next()
        return True

    def process_next(self) -> None:
        """Process the first message, whether time is left or not."""
        message = self._queue.popleft()
        self._bytes -= len(message.data)
        began = self._clock()
        self._process(message)
        self._left -= self._clock() - began

    def _refill(self) -> None:
        now = self._clock()
        self._left = min(AT_ONCE, self._left + SHARE * (now - self._at))
        self._at = now
