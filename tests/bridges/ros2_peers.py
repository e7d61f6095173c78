"""The other side of a bridge: what ROS 2 nodes of several distributions do on a Zenoh network.

Written from the behaviour of rmw_zenoh_cpp (humble 0.1.9, jazzy 0.2.10, kilted 0.6.7, lyrical
0.10.5, rolling 0.12.0) and zenoh-plugin-ros2dds (August 2026), independently of the bridge; only messages are encoded by its types.
"""

import json
import struct
import threading
import time
from functools import partial

import zenoh
import zenoh.ext

from minerva_services.bridges.ros_messages.messages import messages

DEFAULT_QOS = "::,:,:,:,,"
"""Reliable, volatile, depth 42 [liveliness_utils.cpp 364-418, qos.cpp 27]: nothing is written."""

SENSOR_QOS = "2::,5:,:,:,,"
"""Best effort, volatile, depth 5."""

LASTING_QOS = ":1:,1:,:,:,,"
"""Reliable, transient local, depth 1."""

NO_HASH = "TypeHashNotSupported"


def dds(message):
    package, kind, name = message.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def opened(mode, **ends):
    """A session; `connect` or `listen` are its endpoint."""
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "timestamping/enabled": True,
    }
    for key, value in (settings | {f"{way}/endpoints": [end] for way, end in ends.items()}).items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def declared(session, key, lasting):
    if not lasting:
        return session.declare_publisher(key)
    cache = zenoh.ext.CacheConfig(1)
    return zenoh.ext.declare_advanced_publisher(session, key, cache=cache, publisher_detection=True)


class Node:
    """A node of rmw_zenoh. Humble has no hashes of types [humble rmw_publisher_data.cpp 75]."""

    def __init__(self, endpoint, name="robot", *, humble=False, domain=0, namespace=""):
        self.session, self.name, self.domain = opened("client", connect=endpoint), name, domain
        self.namespace, self.humble = namespace or "/", humble
        self.zid, self.entities, self.declared = str(self.session.zid()), 0, []
        self._announce("NN")

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.session.close()

    def key(self, topic, message):
        """[liveliness_utils.cpp 76-95]; a relative name is in the node's namespace."""
        name = topic if topic.startswith("/") else f"{self.namespace.rstrip('/')}/{topic}"
        shown = NO_HASH if self.humble else messages().hash(message)
        return name, f"{self.domain}{name}/{dds(message)}/{shown}"

    def _announce(self, kind, *parts):
        """Declare a token: 9 parts, for endpoints 13 or 14 [liveliness_utils.cpp 155-170]."""
        names = "%", self.namespace.replace("/", "%"), self.name
        self.entities += 1
        number = self.entities - 1
        token = "/".join(
            ("@ros2_lv", str(self.domain), self.zid, "0", str(number), kind, *names, *parts)
        )
        self.declared.append(self.session.liveliness().declare_token(token))

    def _about(self, topic, message, qos):
        name, key = self.key(topic, message)
        return name.replace("/", "%"), dds(message), key.rpartition("/")[2], qos

    def publisher(self, topic, message, qos=DEFAULT_QOS):
        """A function that publishes a message [jazzy rmw_publisher_data.cpp 115-150]."""
        publisher = declared(self.session, self.key(topic, message)[1], qos == LASTING_QOS)
        self.declared.append(publisher)
        self._announce("MP", *self._about(topic, message, qos))
        return lambda value: self.put(publisher, message, value)

    def put(self, publisher, message, value):
        attachment = struct.pack("<qqB16s", 1, time.time_ns(), 16, b"gid")
        publisher.put(messages().encode(message, value), attachment=attachment)

    def subscribe(self, topic, message, receive, qos=DEFAULT_QOS):
        """Receive messages with exactly this key, and with an attachment.

        [rmw_subscription_data.cpp 375-440]
        """

        def on_sample(sample):
            assert sample.attachment is not None
            receive(messages().decode(message, sample.payload.to_bytes()))

        key, declare = self.key(topic, message)[1], self.session.declare_subscriber
        if qos == LASTING_QOS:
            declare = partial(
                zenoh.ext.declare_advanced_subscriber, self.session,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=zenoh.ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
            )  # fmt: skip
        self.declared.append(declare(key, on_sample))
        self._announce("MS", *self._about(topic, message, qos))


class LazyPublisher:
    """A camera's driver, which publishes only while it counts subscriptions.

    Those that require more than it offers are not counted [graph_cache.cpp 869-899].
    """

    def __init__(self, node, topic, message):
        self.node, self._put = node, node.publisher(topic, message, SENSOR_QOS)
        about = node._about(topic, message, SENSOR_QOS)
        self.pattern = f"@ros2_lv/{node.domain}/*/*/*/MS/*/*/*/{about[0]}/{about[1]}/**"

    def put(self, value):
        tokens = self.node.session.liveliness().get(self.pattern)
        qualities = [str(token.ok.key_expr).split("/")[12].split(":") for token in tokens]
        if any(reliable == "2" and lasting != "1" for reliable, lasting, *_ in qualities):
            self._put(value)


class LyricalPublisher:
    """A publisher of a message with bytes in Lyrical and Rolling.

    It decides where it publishes by the tokens of subscriptions [rmw_publisher_data.cpp 276-430,
    494-513, 767-893; buffer_endpoint_helpers.hpp 62-81, 114-118]: for those that understand the
    processor's memory only, once on `_buf_cpu`; for each other one on a key of its own, where only
    a node of the same middleware listens; for nobody, nowhere.
    """

    def __init__(self, node, topic, message):
        self.node, self.message = node, message
        self.base = node.key(topic, message)[1]
        self.subscriptions, self.lock = set(), threading.Lock()
        about = node._about(topic, message, DEFAULT_QOS)
        node._announce("MP", *about, "backends:cpu:")
        pattern = f"@ros2_lv/{node.domain}/*/*/*/MS/*/*/*/{about[0]}/{about[1]}/**"
        liveliness = node.session.liveliness()
        node.declared.append(liveliness.declare_subscriber(pattern, self._on_token, history=True))

    def _on_token(self, sample):
        known = sample.kind == zenoh.SampleKind.PUT
        with self.lock:
            (self.subscriptions.add if known else self.subscriptions.discard)(str(sample.key_expr))

    def put(self, value):
        with self.lock:
            keys = {self._key(token) for token in self.subscriptions}
        for key in keys:
            self.node.put(self.node.session.declare_publisher(key), self.message, value)

    def _key(self, token):
        parts = token.split("/")
        backends = parts[13].removeprefix("backends:").split(";") if len(parts) > 13 else []
        if [name.partition(":")[0] for name in backends] == ["cpu"]:
            return f"{self.base}/_buf_cpu"
        return f"{self.base}/_buf/{abs(hash(token)):032x}"


class DdsBridge:
    """A zenoh-bridge-ros2dds beside a robot; it is a router unless it is configured as a peer.

    All names of the robot get the bridge's own namespace, also `/tf` [ros2_utils.rs 100-113].
    """

    def __init__(self, endpoint, namespace="", mode="router"):
        self.session, self.namespace = opened(mode, listen=endpoint), namespace.strip("/")
        self.declared = []

    def __enter__(self):
        return self

    def __exit__(self, *exc):
        self.session.close()

    def publisher(self, topic, message, *, lasting=False):
        """A function that forwards a message of the robot [route_publisher.rs 140-215]."""
        key = "/".join(filter(None, (self.namespace, topic.strip("/"))))
        publisher = declared(self.session, key, lasting)
        self.declared.append(publisher)
        return lambda value: publisher.put(messages().encode(message, value))
