"""The MQTT bridge: messages become events, and views become messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.semantics.geometry import interpret
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.bridges.mqtt.broker import Broker, Login
from minerva_services.bridges.mqtt.connection import Connection, tls_context
from minerva_services.bridges.mqtt.event_rule import EventRule
from minerva_services.bridges.mqtt.outbox import MqttOutbox
from minerva_services.bridges.mqtt.publication import PLACE, MessageGeometry, publications_of
from minerva_services.bridges.mqtt.rule import checked_qos, rules_of
from minerva_services.bridges.mqtt.traffic import Traffic
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
