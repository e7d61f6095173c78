"""The newest message for each topic, until the broker has it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Message:
    """What a topic shall say, and what it shall say once nobody says so any more."""

    payload: bytes
    qos: int = 0
    retain: bool = False
    gone: bytes | None = None


class Sends(Protocol):
    """What sends messages."""

    def publish(self, topic: str, payload: bytes, qos: int = 0, *, retain: bool = False) -> bool:
        """Send one; False where too many wait to be sent already."""
        ...


class Outbox:
    """What topics shall say: a message goes out when it is another than the one before.

    A topic has one message at most that waits, so it is bounded by the number of topics. After a
    new connection everything goes out again, because the broker may have forgotten it.
    """

    def __init__(self, count: Callable[[str], None]) -> None:
        self.used = False
        self._count = count
        self._wanted: dict[str, Message] = {}
        self._waiting: dict[str, Message] = {}
        self._lock = threading.Lock()

    def put(self, wanted: Mapping[str, Message]) -> None:
        """Let topics say this from now on, and those that are not among them that they are gone."""
        with self._lock:
            self.used = True
            for topic, before in self._wanted.items():
                if topic not in wanted and before.gone is not None:
                    self._wait(topic, Message(before.gone, before.qos, before.retain))
            for topic, message in wanted.items():
                before = self._wanted.get(topic)
                if before is None or before.payload != message.payload:
                    self._wait(topic, message)
            self._wanted = dict(wanted)

    def begin_anew(self) -> None:
        """There is a new connection."""
        with self._lock:
            self._waiting = self._waiting | self._wanted

    def send(self, connection: Sends) -> None:
        """Send what waits, as far as the broker takes it; the rest waits on."""
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        while waiting:
            topic = next(iter(waiting))
            message = waiting[topic]
            if not connection.publish(topic, message.payload, message.qos, retain=message.retain):
                break
            self._count("published")
            del waiting[topic]
        with self._lock:
            self._waiting = waiting | self._waiting

    def _wait(self, topic: str, message: Message) -> None:
        if self._waiting.pop(topic, None) is not None:
            self._count("replaced")  # The broker never heard of the one before.
        self._waiting[topic] = message
