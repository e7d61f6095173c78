"""A session on a robot's Zenoh network, to subscribe to and publish ROS 2 topics.

This network is separate from the world's own.
"""

# Zenoh's type stubs are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, Final

import zenoh
import zenoh.ext

from minerva_services.bridges.ros2.messages import messages
from minerva_services.bridges.ros2.network import GID_BYTES, Attachment, Ros2Network
from minerva_services.bridging import SourceError

_OPEN_TIMEOUT_MS: Final = 2000
_CONFIG: Final[dict[str, Any]] = {
    "mode": "client",
    # Only the given router: scouting could connect the robot's network to the world's own.
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "connect/timeout_ms": _OPEN_TIMEOUT_MS,
    "connect/exit_on_failure": True,
    "connect/retry": {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5},
    "timestamping/enabled": True,  # late subscribers query the newest sample
    # Shorter than Zenoh's default, so that a lost robot is noticed sooner.
    "transport/link/tx/lease": 3000,
    "transport/shared_memory/enabled": False,
}


class TopicPublisher:
    """Publishes messages of one type on one topic."""

    def __init__(self, message: str, publisher: Any, gid: bytes, *, attaches: bool) -> None:
        self._message = message
        self._publisher = publisher
        self._gid = gid
        self._attaches = attaches
        self._sequence = 0

    def put(self, value: Any) -> None:
        """Publish a message; it is lost while the network is unreachable."""
        self._sequence += 1
        data = messages().encode(self._message, value)
        if self._attaches:
            attachment = Attachment(self._sequence, time.time_ns(), self._gid).packed()
            self._publisher.put(data, attachment=attachment)
        else:
            self._publisher.put(data)


class Ros2Session:
    """A named ROS 2 node on a network; call `close` to leave.

    Raises SourceError if the network does not answer.
    """

    def __init__(self, network: Ros2Network, node: str) -> None:
        config = zenoh.Config()
        settings = _CONFIG | {"connect/endpoints": [network.router]}
        if tls := network.tls_settings():
            settings |= {"transport/link/tls": tls}
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError:
            raise SourceError(f"no ROS 2 network answers at {network.router}") from None
        self.network = network
        self._node = node
        self._id = str(self._session.zid())
        self._declared: list[Any] = []
        if network.layout == "rmw_zenoh":
            self._announce_token(network.node_token(self._id, node))

    @property
    def connected(self) -> bool:
        """True while the link to the network's router is up."""
        return bool(list(self._session.info.routers_zid()))

    def subscribe(
        self, topic: str, message: str, receive: Callable[[bytes], None], *, lasting: bool = False
    ) -> None:
        """Subscribe to a topic; Zenoh's threads deliver its payloads. `lasting` includes history.

        Raises SourceError if the session is lost.
        """

        def on_sample(sample: zenoh.Sample) -> None:
            receive(sample.payload.to_bytes())

        pattern = self.network.pattern(topic, message)
        # A publisher of /tf_static may start later than this subscription.
        history = zenoh.ext.HistoryConfig(detect_late_publishers=True)
        declare = self._session.declare_subscriber
        if lasting:
            declare = partial(zenoh.ext.declare_advanced_subscriber, self._session, history=history)
        self._declared.append(_declared(topic, declare, pattern, on_sample))
        self._announce("MS", topic, message, lasting=lasting)

    def publisher(self, topic: str, message: str, *, lasting: bool = False) -> TopicPublisher:
        """A publisher; `lasting` also serves late subscribers.

        Raises SourceError if the session is lost.
        """
        key = self.network.key_of(topic, message, messages().hash(message))
        cache, declare = zenoh.ext.CacheConfig(1), self._session.declare_publisher
        if lasting:
            declare = partial(
                zenoh.ext.declare_advanced_publisher,
                self._session, cache=cache, publisher_detection=True,
            )  # fmt: skip
        declared = _declared(topic, declare, key)
        self._declared.append(declared)
        token = self._announce("MP", topic, message, lasting=lasting)
        # Any 16 bytes that no other publisher has: the token is unique in the network.
        gid = hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()
        attaches = self.network.layout == "rmw_zenoh"
        return TopicPublisher(message, declared, gid, attaches=attaches)

    def close(self) -> None:
        """Leave the network."""
        with suppress(zenoh.ZError):
            for declaration in reversed(self._declared):
                declaration.undeclare()
        self._session.close()

    def _announce(self, kind: Any, topic: str, message: str, *, lasting: bool) -> str:
        # The list only grows, so its length is a number that is unique within the session.
        entity, type_hash = len(self._declared), messages().hash(message)
        token = self.network.topic_token(
            self._id, self._node, entity, kind, topic, message, type_hash, lasting=lasting
        )
        if self.network.layout == "rmw_zenoh":
            self._announce_token(token)
        return token

    def _announce_token(self, token: str) -> None:
        declare = self._session.liveliness().declare_token
        self._declared.append(_declared("a liveliness token", declare, token))


def _declared(what: str, declare: Callable[..., Any], *arguments: Any) -> Any:
    """Declare on Zenoh. Raises SourceError if the session was lost meanwhile."""
    try:
        return declare(*arguments)
    except zenoh.ZError as error:
        raise SourceError(f"{what} cannot be declared: {str(error).split(' at ', 1)[0]}") from None
