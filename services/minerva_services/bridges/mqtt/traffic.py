"""What goes through one connection: messages in, which become events, and messages out."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Final

from minerva_bus.grammar.events import Event
from minerva_services.bridges.mqtt.connection import Connection
from minerva_services.bridges.mqtt.making import Making
from minerva_services.bridges.mqtt.outbox import Outbox
from minerva_services.bridges.mqtt.payload import Garbage

if TYPE_CHECKING:
    from paho.mqtt.client import MQTTMessage

WAITING: Final = 10_000
"""Messages that wait for their turn, at most; the oldest are dropped."""

TURN, SHORT_TURN = 0.2, 0.02


class Allowance:
    """So many a second, and as many at once after a rest; 0: any number."""

    def __init__(self, most: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._most = most
        self._clock = clock
        self._left = float(most)
        self._at = clock()

    def take(self) -> bool:
        """Take one, if it is allowed."""
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
    """A source of events by the rules of `makings`, which sends what is in the outbox too."""

    def __init__(
        self,
        connect: Callable[[Callable[[MQTTMessage], None]], Connection],
        makings: Sequence[Making],
        outbox: Outbox,
        most: int,
        count: Callable[[str], None],
        say: Callable[[str], None],
    ) -> None:
        """Connects. Raises SourceError."""
        self._makings = makings
        self._outbox = outbox
        self._allowed = Allowance(most)
        self._count, self._say = count, say
        self._waiting: deque[MQTTMessage] = deque()
        outbox.begin_anew()
        self._connection = connect(self._receive)
        filters: dict[str, int] = {}
        for making in makings:
            rule = making.rule
            filters[rule.pattern.filter] = max(rule.qos, filters.get(rule.pattern.filter, 0))
        self._connection.subscribe(filters)

    def read(self, stop: threading.Event) -> Iterator[Event | None]:
        """The events that messages become, in their order. Raises SourceError."""
        while not stop.is_set():
            busy = bool(self._waiting) or self._outbox.used
            self._connection.turn(SHORT_TURN if busy else TURN)
            self._outbox.send(self._connection)
            while self._waiting and self._allowed.take():
                yield from self._events(self._waiting.popleft())
            yield None

    def close(self) -> None:
        """Hang up; what still waited to be sent is sent before, if the broker takes it."""
        self._outbox.send(self._connection)
        self._connection.close()

    def _receive(self, message: MQTTMessage) -> None:
        self._count("messages")
        self._waiting.append(message)
        if len(self._waiting) > WAITING:
            self._waiting.popleft()
            self._count("dropped")

    def _events(self, message: MQTTMessage) -> Iterator[Event]:
        for making in self._makings:
            if message.retain and not making.rule.retained:
                self._count("passed over")
                continue
            try:
                made = making(message.topic, bytes(message.payload))
            except Garbage as garbage:
                self._count("garbage")
                self._say_once(making, f"{message.topic}: {garbage}")
                continue
            if made is not None:
                yield made

    def _say_once(self, making: Making, what: str) -> None:
        if not making.complained:
            making.complained = True
            self._say(f"mqtt: {what}; such messages are counted as garbage")
