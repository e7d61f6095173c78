"""Outgoing messages: the newest per topic, until the broker has accepted it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class MqttMessage:
    """What a topic should contain, and what it should contain once its source is gone."""

    payload: bytes
    qos: int = 0
    retain: bool = False
    gone: bytes | None = None


class Sends(Protocol):
    """Something that sends messages."""

    def publish(self, topic: str, payload: bytes, qos: int = 0, *, retain: bool = False) -> bool:
        """Send a message; False while earlier ones are still being sent."""
        ...


class MqttOutbox:
    """Desired content of topics; a message is sent when its payload changes.

    At most one message per topic waits, so the size is bounded by the number of topics. After a
    reconnect all content is sent again, because the broker may have lost it.
    """

    def __init__(self, count: Callable[[str], None]) -> None:
        # Until the first content, `Traffic` has nothing to send and may poll slowly.
        self.used = False
        self._count = count
        self._wanted: dict[str, MqttMessage] = {}
        self._waiting: dict[str, MqttMessage] = {}
        self._lock = threading.Lock()

    def put(self, wanted: Mapping[str, MqttMessage]) -> None:
        """Set the desired content; topics missing from it receive their `gone` message."""
        with self._lock:
            self.used = True
            for topic, before in self._wanted.items():
                if topic not in wanted and before.gone is not None:
                    self._wait(topic, MqttMessage(before.gone, before.qos, before.retain))
            for topic, message in wanted.items():
                before = self._wanted.get(topic)
                if before is None or before.payload != message.payload:
                    self._wait(topic, message)
            self._wanted = dict(wanted)

    def reconnected(self) -> None:
        """Queue all content again after a reconnect."""
        with self._lock:
            self._waiting = self._waiting | self._wanted

    def send(self, connection: Sends) -> None:
        """Send queued messages until the broker accepts no more; keep the rest."""
        with self._lock:
            # Taken out of the lock: sending may block while the world puts new content.
            waiting, self._waiting = self._waiting, {}
        while waiting:
            topic = next(iter(waiting))
            message = waiting[topic]
            if not connection.publish(topic, message.payload, message.qos, retain=message.retain):
                break
            self._count("published")
            del waiting[topic]
        with self._lock:
            # Content that was put meanwhile replaces what could not be sent.
            self._waiting = waiting | self._waiting

    def _wait(self, topic: str, message: MqttMessage) -> None:
        # Removed and added at the end, so that a topic that changes often cannot delay the others.
        if self._waiting.pop(topic, None) is not None:
            self._count("replaced")  # the previous message was never sent
        self._waiting[topic] = message
