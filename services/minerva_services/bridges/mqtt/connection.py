"""A connection to a broker, from the handshake to its loss; used by one thread."""

# paho's type hints are incomplete.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import ssl
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.errors import MisuseError
from minerva_services.bridges.mqtt.broker import Broker, Login
from minerva_services.bridging import SourceError

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage

CONNECT_SECONDS: Final = 5.0
# In seconds: after one and a half times this, a broker publishes the last will (MQTT 3.1.1,
# 3.1.2.10).
KEEPALIVE: Final = 15
MAX_QUEUED: Final = 1000
ONLINE, OFFLINE = b"online", b"offline"


def tls_context(login: Login) -> ssl.SSLContext:
    """The TLS context for a login. Raises MisuseError for missing or invalid files."""
    for name, path in (("ca", login.ca), ("cert", login.cert), ("key", login.key)):
        if path and not Path(path).is_file():
            raise MisuseError(f"mqtt: {name}: file {path} does not exist")
    try:
        context = ssl.create_default_context(cafile=login.ca or None)
        if login.cert:
            context.load_cert_chain(login.cert, login.key or None)
    except (ssl.SSLError, OSError) as error:
        raise MisuseError(f"mqtt: ca, cert and key are not matching PEM files: {error}") from None
    return context


class Connection:
    """An established connection to a broker.

    Calls `receive` for each message during `turn`. If `status` is a topic, the connection publishes
    `online` there, and the broker publishes `offline` when it is lost (last will).
    """

    def __init__(
        self,
        broker: Broker,
        login: Login,
        receive: Callable[[MQTTMessage], None],
        *,
        keeps: bool = False,
        status: str = "",
    ) -> None:
        self.broker = broker
        self._status = status
        self._refused: dict[int, str] = {}
        self._greeted = False
        self._wrong = ""
        self._client = _client(broker, login, keeps)
        client = self._client
        client.on_connect = self._on_connect
        client.on_subscribe = self._on_subscribe
        client.on_message = lambda _client, _data, message: receive(message)
        if status:
            # The last will is part of the CONNECT packet, so it is set before connecting.
            client.will_set(status, OFFLINE, 1, retain=True)
        try:
            self._connect()
        except BaseException:
            self._close_socket()
            raise
        if status:
            self.publish(status, ONLINE, 1, retain=True)

    def subscribe(self, filters: dict[str, int]) -> None:
        """Subscribe to topic filters, each with its QoS."""
        for pattern, qos in sorted(filters.items()):
            _, number = self._client.subscribe(pattern, qos)
            self._refused[number or 0] = pattern

    def publish(self, topic: str, payload: bytes, qos: int = 0, *, retain: bool = False) -> bool:
        """Send a message; False while earlier ones are still being sent."""
        # paho would queue the message; a newer one of its topic could then not replace it.
        if self._client.want_write():
            return False
        return self._client.publish(topic, payload, qos, retain).rc == 0

    def turn(self, wait: float) -> None:
        """Process the connection for at most `wait` seconds. Raises SourceError."""
        try:
            failed = self._client.loop(wait)
        except OSError as error:
            raise self._lost(str(error)) from None
        # Callbacks run within `loop`, so their errors can be raised only after it.
        if failed or self._wrong:
            raise self._lost(self._wrong or "connection lost")

    def close(self) -> None:
        """Publish `offline` explicitly, disconnect and close."""
        client = self._client
        try:
            if self._status:
                # A broker does not send the last will after an orderly disconnection.
                client.publish(self._status, OFFLINE, 0, retain=True)
            client.disconnect()
            client.loop(0.1)
        except OSError:
            pass  # already disconnected
        self._close_socket()

    # --- handshake ---

    def _connect(self) -> None:
        try:
            self._client.connect(self.broker.host, self.broker.port, KEEPALIVE)
        except ssl.SSLCertVerificationError as error:
            raise self._unreachable(f"its certificate: {error.verify_message}") from None
        except (OSError, ValueError) as error:
            raise self._unreachable(getattr(error, "strerror", None) or str(error)) from None
        until = time.monotonic() + CONNECT_SECONDS
        while not self._greeted:
            self.turn(0.1)
            if time.monotonic() > until:
                raise self._unreachable("no MQTT handshake within the time limit")

    def _on_connect(self, _client: Any, _data: Any, _flags: Any, code: Any, _more: Any) -> None:
        self._greeted = not code.is_failure
        self._wrong = f"connection refused: {code}" if code.is_failure else ""

    def _on_subscribe(self, _client: Any, _data: Any, number: int, codes: Any, _more: Any) -> None:
        pattern = self._refused.pop(number, "a topic")
        if any(code.is_failure for code in codes):
            self._wrong = f"subscription to {pattern} refused"

    def _unreachable(self, why: str) -> SourceError:
        return SourceError(f"mqtt: cannot connect to the broker {self.broker}: {why}")

    def _lost(self, why: str) -> SourceError:
        return SourceError(f"mqtt: the broker {self.broker}: {why}")

    def _close_socket(self) -> None:
        socket = self._client.socket()
        if socket is not None:
            socket.close()


def _client(broker: Broker, login: Login, keeps: bool) -> Client:
    from paho.mqtt.client import Client, MQTTv311
    from paho.mqtt.enums import CallbackAPIVersion

    client = Client(
        CallbackAPIVersion.VERSION2,
        client_id=login.client,
        clean_session=not keeps,
        protocol=MQTTv311,
        # The bridge reconnects itself, and counts and logs its attempts.
        reconnect_on_failure=False,
    )
    client.connect_timeout = CONNECT_SECONDS
    client.max_queued_messages_set(MAX_QUEUED)
    if login.user:
        client.username_pw_set(login.user, login.password())
    if broker.tls:
        client.tls_set_context(tls_context(login))
    return client
