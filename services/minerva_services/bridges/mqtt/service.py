"""The bridge to MQTT: messages of a broker become events, figures of a view become messages."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Final

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import Event
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.bridges.mqtt.connection import (
    Broker,
    Connection,
    Login,
    MqttOutbox,
    tls_context,
)
from minerva_services.bridges.mqtt.rules import (
    PLACE,
    EventRule,
    InvalidPayload,
    MessageGeometry,
    checked_qos,
    publications_of,
    rules_of,
)
from minerva_services.bridging import Bridge
from minerva_services.event_factory import event_type
from minerva_services.options import require, takes_options

if TYPE_CHECKING:
    from paho.mqtt.client import MQTTMessage


class Mqtt(Bridge, Device, when="freely"):
    """Events from the messages of an MQTT broker, and messages from a world's views.

    As a device its geometric system consists of messages: α of a primitive is a publication.

    Args:
        broker: `mqtt://HOST[:PORT]`, or `mqtts://` for TLS; user, password and certificates are the
          options of `Login`.
        topics: incoming messages: by topic pattern an event type, a table, or a list of these.
        publish: outgoing messages: by primitive a topic, or a table.
        draws: the visual event type whose views are published.
        every: frames between views; 0 leaves requesting them to a generator.
        keeps: whether the broker stores messages of QoS 1 or 2 for this client id while the bridge
          is disconnected.
        qos: default QoS of subscriptions and publications: 0, 1 or 2.
        status: a topic that reads `online` while the bridge is connected, otherwise `offline`.
        most: maximum events per second; the excess waits, and is dropped if too much waits. 0: no
          limit.
        people: whether norms treat incoming events as sent by people; false: as sent by the bridge,
          like those of a sensor.

    """

    source_option: ClassVar[str] = "broker"

    @takes_options(Login)
    def __init__(
        self,
        broker: str,
        topics: Mapping[str, Any] | None = None,
        publish: Mapping[str, Any] | None = None,
        draws: str = "ePicture",
        every: int = 1,
        keeps: bool = False,
        qos: int = 0,
        status: str = "",
        most: int = 1000,
        people: bool = True,
        **login: Any,
    ) -> None:
        super().__init__()
        self.people = people
        self._broker = Broker.at(broker)
        self._login = Login(**login)
        _check(keeps and not self._login.client, "keeps requires the option client")
        _check(every < 0, f"every is {every}; expected a number of frames from 0")
        _check(most < 0, f"most is {most}; expected a number of events per second from 0")
        _check(bool(set(status) & set("+#\0")), f"status is {status!r}; expected a topic")
        _check(not topics and not publish, "nothing to do; give topics (in), publish (out) or both")
        self._keeps, self._status, self._most = keeps, status, most
        self.source = f"mqtt: the broker {self._broker}"
        checked_qos("mqtt", qos)
        self._rules = rules_of(_mapping("topics", topics), qos)
        self._publications = publications_of(_mapping("publish", publish), qos)
        # Without publications, no views are needed.
        self.draws = (draws,) if self._publications else ()
        if self.draws and every:
            self.when = f"freely, each {every} frames"
        self._outbox = MqttOutbox(self.count)
        self._event_rules: list[EventRule] = []
        self._reported: set[str] = set()

    def generates(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(rule.event for rule in self._rules))

    def check(self, world: WorldInfo) -> None:
        require("mqtt", "paho.mqtt.client", "paho-mqtt", "mqtt")
        self._vocabulary = world.vocabulary
        self._event_rules = [
            EventRule(rule, world.vocabulary, event_type("mqtt", world, rule.event))
            for rule in self._rules
        ]
        self._check_publications()
        # Missing secrets and certificates are errors of the configuration: raised here they are
        # reported at once, in `open` they would be retried.
        self._login.password()
        if self._broker.tls:
            tls_context(self._login)

    def _check_publications(self) -> None:
        primitives = self._vocabulary.primitives
        around = {
            name for kind in self._vocabulary.transformations.values() for name in kind.fields.names
        }
        for symbol, how in self._publications.items():
            near = nearest(symbol, list(primitives))
            _check(symbol not in primitives, f"the world has no primitive {symbol}{near}")
            known = {*PLACE, *around, *primitives[symbol].fields.names}
            for name in sorted(how.names() - known):
                near = nearest(name, sorted(known))
                _check(True, f"publish.{symbol}: unknown parameter {name}{near}")

    # --- incoming ---

    def open(self) -> Traffic:
        return Traffic(
            self._connect, self._event_rules, self._outbox, self._most, self.count, self._log
        )

    def _connect(self, receive: Callable[[MQTTMessage], None]) -> Connection:
        return Connection(
            self._broker, self._login, receive, keeps=self._keeps, status=self._status
        )

    # --- outgoing ---

    def show(self, view: View) -> None:
        messages = MessageGeometry(self._vocabulary, self._publications, self._report_problem)
        interpret(view.scene, messages)
        self._outbox.put(messages.messages)

    def _report_problem(self, problem: str) -> None:
        self.count("unpublished")
        # Problems contain values of figures, so there may be any number of them.
        if problem not in self._reported and len(self._reported) < 10:
            self._reported.add(problem)
            self._log(f"mqtt: {problem}; such figures are counted as unpublished")


def _check(wrong: bool, problem: str) -> None:
    if wrong:
        raise MisuseError(f"mqtt: {problem}")


def _mapping(name: str, given: Mapping[str, Any] | None) -> Mapping[str, Any]:
    if given is not None and not isinstance(given, Mapping):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"mqtt: {name} must be a table")
    return given or {}


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
