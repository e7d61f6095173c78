"""Traffic of one connection: incoming messages become events, queued messages are sent."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from minerva_bus.grammar.events import Event
from minerva_services.bridges.mqtt.connection import Connection
from minerva_services.bridges.mqtt.event_rule import EventRule, InvalidPayload
from minerva_services.bridges.mqtt.outbox import MqttOutbox

if TYPE_CHECKING:
    from paho.mqtt.client import MQTTMessage

MAX_QUEUED: Final = 10_000
"""Maximum number of queued messages; the oldest are dropped."""

# Longest wait for the network, without and with something to send.
POLL_SECONDS, FLUSH_SECONDS = 0.2, 0.02


class RateLimiter:
    """Token bucket of `most` per second with a burst of the same size; 0: unlimited."""

    def __init__(self, most: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._most = most
        self._clock = clock
        self._left = float(most)
        self._at = clock()

    def take(self) -> bool:
        """Take a token, if one is available."""
        if not self._most:
            return True
        now = self._clock()
        self._left = min(self._left + (now - self._at) * self._most, float(self._most))
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class Traffic:
    """A source of events by the given rules, which also sends the outbox."""

    def __init__(
        self,
        connect: Callable[[Callable[[MQTTMessage], None]], Connection],
        event_rules: Sequence[EventRule],
        outbox: MqttOutbox,
        most: int,
        count: Callable[[str], None],
        log: Callable[[str], None],
    ) -> None:
        """Connect. Raises SourceError."""
        self._event_rules = event_rules
        self._outbox = outbox
        self._allowed = RateLimiter(most)
        self._count, self._log = count, log
        self._waiting: deque[MQTTMessage] = deque()
        # Before subscribing: retained messages may arrive at once.
        outbox.reconnected()
        self._connection = connect(self._receive)
        filters: dict[str, int] = {}
        for rule in event_rules:
            topic_rule = rule.rule
            pattern = topic_rule.pattern.filter
            # A second subscription to a filter replaces the first (MQTT 3.1.1, 3.8.4), so rules
            # with the same filter share the highest QoS.
            filters[pattern] = max(topic_rule.qos, filters.get(pattern, 0))
        self._connection.subscribe(filters)

    def read(self, stop: threading.Event) -> Iterator[Event | None]:
        """The events of incoming messages, in order. Raises SourceError."""
        while not stop.is_set():
            # `turn` wakes for network traffic only, not for content that the world puts meanwhile,
            # nor for new tokens of the rate limiter.
            busy = bool(self._waiting) or self._outbox.used
            self._connection.turn(FLUSH_SECONDS if busy else POLL_SECONDS)
            self._outbox.send(self._connection)
            while self._waiting and self._allowed.take():
                yield from self._events(self._waiting.popleft())
            yield None

    def close(self) -> None:
        """Disconnect, after sending what the broker still accepts."""
        self._outbox.send(self._connection)
        self._connection.close()

    def _receive(self, message: MQTTMessage) -> None:
        self._count("messages")
        self._waiting.append(message)
        if len(self._waiting) > MAX_QUEUED:
            self._waiting.popleft()
            self._count("dropped")

    def _events(self, message: MQTTMessage) -> Iterator[Event]:
        for rule in self._event_rules:
            # A retained message is a state from before the subscription (MQTT 3.1.1, 3.3.1.3).
            if message.retain and not rule.rule.retained:
                self._count("passed over")
                continue
            try:
                event = rule(
                    message.topic,
                    bytes(message.payload),
                    partial(self._note, rule, message.topic),
                )
            except InvalidPayload as problem:
                self._note(rule, message.topic, "garbage", str(problem))
                continue
            if event is not None:
                yield event

    def _note(self, rule: EventRule, topic: str, metric: str, reason: str) -> None:
        """Count a message of a rule, and log the first with this metric."""
        self._count(metric)
        if metric not in rule.reported:
            rule.reported.add(metric)
            self._log(f"mqtt: {topic}: {reason}; such messages are counted as {metric}")
