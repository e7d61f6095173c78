"""A broker, a connection to it, and the messages that wait for it.

Of each topic only the newest outgoing message waits, until the broker has accepted it. A connection
lasts from the handshake to its loss; one thread uses it.
"""

from __future__ import annotations

import ssl
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol
from urllib.parse import SplitResult, urlsplit

from minerva_bus.errors import MisuseError
from minerva_services.bridging import SourceError
from minerva_services.options import read_password

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage


_PORTS: Final = {"mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True, slots=True)
class Login:
    """Client id, user, and where the password and certificates are stored.

    Args:
        client: the client id; assigned by the broker by default.
        user: user name; its password is in an environment variable or a file.
        password_env: the environment variable.
        password_file: the file.
        ca: a PEM file of trusted authorities; the system's by default.
        cert: a PEM file with a client certificate, for brokers that require one.
        key: its key, if that is in another file.

    Raises MisuseError for options that exclude or require each other.

    """

    client: str = ""
    user: str = ""
    password_env: str = ""
    password_file: str = ""
    ca: str = ""
    cert: str = ""
    key: str = ""

    def __post_init__(self) -> None:
        if self.password_env and self.password_file:
            raise MisuseError("mqtt: set password_env or password_file, not both")
        if (self.password_env or self.password_file) and not self.user:
            raise MisuseError("mqtt: a password requires the option user")
        if self.key and not self.cert:
            raise MisuseError("mqtt: a key requires the option cert")

    def password(self) -> str | None:
        """The password, read from its storage. Raises MisuseError."""
        if not self.password_env and not self.password_file:
            return None
        return read_password("mqtt", self.password_env, self.password_file)


@dataclass(frozen=True, slots=True)
class Broker:
    """Address of a broker."""

    host: str
    port: int
    tls: bool

    @staticmethod
    def at(address: str) -> Broker:
        """Parse `mqtt://HOST[:PORT]`, or `mqtts://` for TLS. Raises MisuseError."""
        url = address if "://" in address else f"mqtt://{address}"
        try:
            parts = urlsplit(url)
            # Raises ValueError for a number above 65535.
            port = parts.port
        except ValueError:
            raise _bad_address(address) from None
        if parts.scheme not in _PORTS or not parts.hostname or _has_extra_parts(parts):
            raise _bad_address(address)
        if parts.username is not None or parts.password is not None:
            raise MisuseError(
                "mqtt: user and password do not belong in the address; use the options user and"
                " password_env or password_file"
            )
        return Broker(parts.hostname, port or _PORTS[parts.scheme], parts.scheme == "mqtts")

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def _has_extra_parts(parts: SplitResult) -> bool:
    return bool(parts.path.strip("/") or parts.query or parts.fragment)


def _bad_address(address: str) -> MisuseError:
    shown = address.rpartition("@")[2]  # the part before may contain a password
    return MisuseError(
        f"mqtt: broker is {shown!r}; expected mqtt://HOST, mqtt://HOST:PORT or mqtts://HOST for TLS"
    )


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


# paho's type hints are incomplete.
# pyright: reportUnknownMemberType=false


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
