"""Sessions on a robot's network: publishers, subscriptions, and links that are opened again.

This network is separate from the world's own. A `NetworkLink` opens a session in its own thread,
watches it, and opens it again when it is lost.
"""

# Zenoh's type stubs are incomplete.
# pyright: reportUnknownMemberType=false, reportUnknownLambdaType=false
from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Collection, Sequence
from contextlib import closing, suppress
from functools import partial
from typing import Any, Final, TypeAlias

import zenoh
import zenoh.ext

from minerva_bus.errors import MisuseError
from minerva_services.bridges.ros2.graph import NO_HASH, SERVER, TOKENS, Announced, RosGraph
from minerva_services.bridges.ros2.layout import Attachment, Ros2Network, gid_of
from minerva_services.bridges.ros2.qos import DEFAULT, HEARING, KEEP_ALL, MAX_DEPTH, Qos
from minerva_services.bridges.ros2.uses import TopicUse, is_of, mismatches
from minerva_services.bridges.ros_messages.messages import messages
from minerva_services.bridging.bridge import SourceError, log

_HEARTBEAT_SECONDS: Final = 0.5
"""How often a lasting publisher repeats the number of its last message, as in rmw_zenoh."""

MAX_ANSWER_BYTES: Final = 1 << 20
"""Maximum size of the answer of a service."""

_OPEN_TIMEOUT_MS: Final = 2000
_LOOK_TIMEOUT_MS: Final = 700
"""Shorter, because a person waits for the answer."""

_CONFIG: Final[dict[str, Any]] = {
    "mode": "client",
    # Only the given router: scouting could connect the robot's network to the world's own.
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,
    "connect/exit_on_failure": True,
    "connect/retry": {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5},
    "timestamping/enabled": True,  # late subscribers query the newest sample
    # Shorter than Zenoh's default, so that a lost robot is noticed sooner.
    "transport/link/tx/lease": 3000,
    "transport/shared_memory/enabled": False,
}


class TopicPublisher:
    """Publishes messages of one type on one topic.

    Which keys it uses depends on the subscriptions: those of Humble have no hash of the type in
    theirs. `listened` yields the hashes that subscriptions expect at present, `declare` makes a
    publisher of Zenoh for a hash. With a `gid`, messages have an attachment.
    """

    def __init__(
        self, message: str, declare: Callable[[str], Any], listened: Callable[[], set[str]],
        gid: bytes | None, *, lasting: bool,
    ) -> None:  # fmt: skip
        self._message, self._gid, self._lasting = message, gid, lasting
        self._declare, self._listened = declare, listened
        self._hash = messages().hash(message)
        self._lock = threading.Lock()
        self._publishers = {self._hash: declare(self._hash)}
        self._sequence, self._is_closed = 0, False
        self._last: tuple[bytes, bytes | None] | None = None

    def put(self, value: Any) -> None:
        """Publish a message; it is lost while the network is unreachable, and after the session."""
        data = messages().encode(self._message, value)
        with self._lock:
            self._sequence += 1
            attachment = None
            if self._gid is not None:
                attachment = Attachment(self._sequence, time.time_ns(), self._gid).packed()
            listened = self._extended()
            if self._lasting:
                self._last = data, attachment
            for type_hash, publisher in self._publishers.items():
                # Subscriptions to any hash must not receive a message twice.
                if self._lasting or type_hash in listened:
                    publisher.put(data, attachment=attachment)

    def serve(self) -> None:
        """Serve subscriptions that have appeared: a lasting message is for them, too."""
        with self._lock:
            self._extended()

    def _extended(self) -> set[str]:
        """Declare what is missing for the present subscriptions; returns the hashes to use."""
        if self._is_closed:
            return set()
        listened = self._listened() & {self._hash, NO_HASH} or {self._hash}
        for type_hash in listened - self._publishers.keys():
            publisher = self._publishers[type_hash] = self._declare(type_hash)
            if self._last is not None:
                data, attachment = self._last
                publisher.put(data, attachment=attachment)
        return listened

    def undeclare(self) -> None:
        """Publish nothing further."""
        with self._lock:
            self._is_closed = True
            for publisher in self._publishers.values():
                publisher.undeclare()
            self._publishers.clear()


class Gaps:
    """Counts the messages that are missing, by the numbers that each publisher gives its own.

    `numbers` returns how many each message has at present.
    """

    def __init__(self, numbers: Callable[[], int]) -> None:
        self._latest: dict[bytes, int] = {}
        self._numbers, self._each = numbers, 1

    def before(self, attachment: zenoh.ZBytes | None) -> int:
        """How many are missing before the message of an attachment; 0 without a number."""
        if attachment is None:
            return 0
        with suppress(MisuseError):
            about = Attachment.unpacked(attachment.to_bytes())
            latest = self._latest.get(about.gid, about.sequence)
            self._latest[about.gid] = max(latest, about.sequence)
            passed = about.sequence - latest
            if passed > 1:
                # When a subscription comes or goes, the messages in between have either.
                before, self._each = self._each, self._numbers()
                return max(0, passed // max(before, self._each) - 1)
        return 0


Answer: TypeAlias = "Callable[[bytes | None, str], None]"
"""Called with an answer in CDR, or with a problem: None means that there is no answer."""


class _Answers:
    """What becomes of a request: calls `answer` once, with an answer or the reason for none."""

    def __init__(self, what: str, answer: Answer) -> None:
        self._what, self._answer = what, answer
        self._lock = threading.Lock()
        self._is_answered = False

    def on_reply(self, reply: zenoh.Reply) -> None:
        """Several servers of a service may reply; the first counts."""
        if reply.ok is None:
            self._once(b"", f"{self._what} answers with an error")
            return
        size = len(reply.ok.payload)
        if size > MAX_ANSWER_BYTES:
            problem = f"the answer of {self._what} has {size} bytes, at most {MAX_ANSWER_BYTES}"
            self._once(b"", f"{problem} are read")
        else:
            self._once(reply.ok.payload.to_bytes(), "")

    def on_end(self) -> None:
        """The time is over, or all servers have replied or gone."""
        self._once(None, f"{self._what} does not answer")

    def _once(self, data: bytes | None, problem: str) -> None:
        with self._lock:
            if self._is_answered:
                return
            self._is_answered = True
        self._answer(data, problem)


def _opened(network: Ros2Network, timeout_ms: int = _OPEN_TIMEOUT_MS) -> zenoh.Session:
    config = zenoh.Config()
    settings = _CONFIG | {
        "connect/endpoints": [network.router],
        "connect/timeout_ms": timeout_ms,
    }
    if tls := network.tls_settings():
        settings |= {"transport/link/tls": tls}
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        why = _obstacle(network.router, timeout_ms / 1000)
        raise SourceError(f"no ROS 2 network answers at {network.router}: {why}") from None


def _obstacle(router: str, seconds: float) -> str:
    """Why no session can be opened at an endpoint, and what to do."""
    protocol, _, address = router.partition("/")
    if protocol not in ("tcp", "tls"):
        return "start its Zenoh router, and check the address"
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), seconds).close()
    except (socket.gaierror, UnicodeError):
        return f"there is no host {host}; check the name, or give its address"
    except (ValueError, OverflowError):
        return f"{address} has no port; expected HOST:7447"
    except ConnectionRefusedError:
        return f"nothing listens at port {port} of {host}; start its Zenoh router, or set its port"
    except TimeoutError:
        return f"{host} is off, or a firewall blocks port {port}"
    except OSError as error:
        return f"{error.strerror or error}; check the address"
    why = " or refuses the certificates" if protocol == "tls" else ""
    return f"what listens there is no Zenoh router{why}; check protocol and port"


def look_at(network: Ros2Network, seconds: float) -> RosGraph:
    """Everything that is announced on a network, without taking part in it.

    `seconds` is the longest wait for an answer. Raises SourceError if the network does not answer.
    """
    graph = RosGraph()
    with _opened(network, _LOOK_TIMEOUT_MS) as session:
        for pattern in TOKENS:
            for reply in session.liveliness().get(pattern, timeout=seconds):
                if reply.ok is not None:
                    graph.update(str(reply.ok.key_expr), is_there=True)
    return graph


class Ros2Session:
    """A ROS 2 node on a network; call `close` to leave.

    Its name is `node` with a part of the session's id, because other nodes of a domain may be of
    the same kind. `uses` are the topics about which it advises. Raises SourceError if the network
    does not answer.
    """

    def __init__(self, network: Ros2Network, node: str, uses: Sequence[TopicUse] = ()) -> None:
        self._session = _opened(network)
        self.network = network
        self._id = str(self._session.zid())
        self.node = f"{node}_{self._id[:8]}"
        self._declared: list[Any] = []
        self._publishers: list[TopicPublisher] = []
        self._clients: dict[tuple[str, str], bytes] = {}
        self._requests = 0
        self._uses, self._heard = uses, set[str]()
        self._changed, self._noticed, self._judged = time.monotonic(), 0.0, 0.0
        self._problems: list[str] = []
        self.graph = RosGraph(self._id)
        for pattern in TOKENS:
            watch = partial(self._session.liveliness().declare_subscriber, history=True)
            self._declared.append(_declared("its nodes", watch, pattern, self._on_token))
        self._announce(network.node_token(self._id, self.node))

    def _on_token(self, sample: zenoh.Sample) -> None:
        self.graph.update(str(sample.key_expr), is_there=sample.kind == zenoh.SampleKind.PUT)
        self._changed = time.monotonic()
        for publisher in list(self._publishers):
            # The session may be closed meanwhile, in another thread.
            with suppress(SourceError, zenoh.ZError):
                publisher.serve()

    def advise(self, heard: Collection[str] = ()) -> None:
        """Log how the robot differs from what is expected, when its nodes had time to start.

        It is judged again when nodes have changed, for example the type of a topic. `heard` are the
        types of messages that have arrived since the last call.
        """
        changed = self._changed
        if self._judged == changed:
            return
        if self._noticed != changed:
            # What has come from other nodes says nothing of the present ones.
            self._noticed = changed
            self._heard.clear()
        self._heard.update(heard)
        if time.monotonic() - changed < _ADVICE_SECONDS:
            return
        self._judged = changed
        differences = mismatches(self.graph, self.network, self._uses, self._heard)
        problems = [problem for _, problem in differences]
        for problem in problems:
            if problem not in self._problems:
                log(f"the ROS 2 network at {self.network.router}: {problem}")
        self._problems = problems

    @property
    def connected(self) -> bool:
        """True while the link to the network's router, or to a bridge that is a peer, is up."""
        info = self._session.info
        return bool([*info.routers_zid(), *info.peers_zid()])

    def subscribe(
        self, topic: str, message: str, receive: Callable[[bytes], None],
        qos: Qos = HEARING, *, lost: Callable[[int], None] | None = None,
    ) -> None:  # fmt: skip
        """Subscribe to a topic; Zenoh's threads deliver its payloads.

        `lost` receives how many messages are missing before one that arrives. Raises SourceError
        if the session is lost.
        """
        has_bytes, name = messages().has_bytes(message), f"/{self.network.name(topic)}"
        gaps = Gaps(lambda: self.graph.numbers(name, message) if has_bytes else 1)

        def on_sample(sample: zenoh.Sample) -> None:
            if lost is not None and (missing := gaps.before(sample.attachment)):
                lost(missing)
            receive(sample.payload.to_bytes())

        # Zenoh would keep 256 messages for a thread of its own, which are gigabytes of images. In
        # the thread that receives them, its network drops what is too much.
        handler = zenoh.handlers.Callback(on_sample, indirect=not has_bytes)
        pattern = self.network.pattern(topic, message)
        # A publisher of /tf_static may start later than this subscription.
        history = zenoh.ext.HistoryConfig(
            detect_late_publishers=True,
            max_samples=qos.depth if 0 < qos.depth < KEEP_ALL else None,
        )
        recovery = zenoh.ext.RecoveryConfig(heartbeat=True, periodic_queries=None)
        declare = self._session.declare_subscriber
        if qos.lasting:
            declare = partial(
                zenoh.ext.declare_advanced_subscriber,
                self._session, history=history, recovery=recovery if qos.reliable else None,
            )  # fmt: skip
        self._declared.append(_declared(topic, declare, pattern, handler))
        # From Lyrical on, nothing is sent to a subscription without a list of the memory that it
        # understands. Lasting messages are never shared.
        buffered = has_bytes and not qos.lasting and self.network.layout == "rmw_zenoh"
        if buffered:
            shared = self.network.buffered_pattern(topic, message)
            self._declared.append(_declared(topic, declare, shared, handler))
        self._announce(self._token("MS", topic, message, qos, buffered=buffered))

    def publisher(self, topic: str, message: str, qos: Qos = DEFAULT) -> TopicPublisher:
        """A publisher. Raises SourceError if the session is lost."""
        cache = zenoh.ext.CacheConfig(min(qos.depth or 1, MAX_DEPTH))
        kind = zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT
        # As in rmw_zenoh: who keeps all waits for a slow network, all others drop for it.
        waits = qos.reliable and qos.depth == KEEP_ALL
        full = zenoh.CongestionControl.BLOCK if waits else zenoh.CongestionControl.DROP
        quality = {"reliability": kind, "congestion_control": full}
        declare = partial(self._session.declare_publisher, **quality)
        # Subscribers learn from it that they have missed a message, and get it from the cache.
        heartbeat = zenoh.ext.MissDetectionConfig(
            sporadic_heartbeat=_HEARTBEAT_SECONDS, heartbeat=None
        )
        if qos.lasting:
            declare = partial(
                zenoh.ext.declare_advanced_publisher,
                self._session, cache=cache, publisher_detection=True, **quality,
                sample_miss_detection=heartbeat if qos.reliable else None,
            )  # fmt: skip
        network, name = self.network, f"/{self.network.name(topic)}"
        token = self._token("MP", topic, message, qos)
        publisher = TopicPublisher(
            message,
            lambda type_hash: _declared(topic, declare, network.key_of(topic, message, type_hash)),
            lambda: self.graph.hashes(name, message),
            gid_of(token) if network.layout == "rmw_zenoh" else None,
            lasting=qos.lasting,
        )
        self._publishers.append(publisher)
        self._declared.append(publisher)
        self._announce(token)
        return publisher

    def server(self, service: str, kind: str) -> Announced | None:
        """A server of a service of a type, as it is announced at present."""
        name = f"/{self.network.name(service)}"
        for each in self.graph:
            fits = (each.kind, each.topic, each.message) == (SERVER, name, kind)
            if fits and is_of(each, self.network):
                return each
        return None

    def call(self, service: str, kind: str, data: bytes, seconds: float, answer: Answer) -> None:
        """Send a request to a service of a type, which has `seconds` to answer.

        `answer` is called once, in any thread. Raises SourceError if the session is lost.
        """
        answers = _Answers(f"the service /{self.network.name(service)}", answer)
        attachment, type_hash = None, ""
        if self.network.layout == "rmw_zenoh":
            # Servers receive requests to exactly their own key, which has the hash of their type.
            server = self.server(service, kind)
            if server is None:
                answers.on_end()
                return
            type_hash = server.type_hash
            self._requests += 1
            gid = self._client(service, kind, type_hash)
            attachment = Attachment(self._requests, time.time_ns(), gid).packed()
        try:
            self._session.get(
                self.network.key_of(service, kind, type_hash),
                zenoh.handlers.Callback(answers.on_reply, answers.on_end),
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=seconds, payload=data, attachment=attachment,
            )  # fmt: skip
        except zenoh.ZError as error:
            raise SourceError(f"{service} cannot be called: {error}") from None

    def _client(self, service: str, kind: str, type_hash: str) -> bytes:
        """The gid of this session's client of a service, which is announced when it is new."""
        if (service, type_hash) not in self._clients:
            token = self._token("SC", service, kind, DEFAULT, type_hash)
            self._announce(token)
            self._clients[service, type_hash] = gid_of(token)
        return self._clients[service, type_hash]

    def close(self) -> None:
        """Leave the network."""
        with suppress(zenoh.ZError):
            for declaration in reversed(self._declared):
                declaration.undeclare()
        self._session.close()

    def _token(
        self, kind: Any, topic: str, message: str, qos: Qos, type_hash: str = "",
        *, buffered: bool = False,
    ) -> str:  # fmt: skip
        # The list only grows, so its length is a number that is unique within the session.
        entity, type_hash = len(self._declared), type_hash or messages().hash(message)
        return self.network.topic_token(
            self._id, self.node, entity, kind, topic, message, type_hash, qos, buffered=buffered
        )

    def _announce(self, token: str) -> None:
        """Declare a liveliness token; a bridge for DDS finds its counterparts by other means."""
        if self.network.layout == "rmw_zenoh":
            declare = self._session.liveliness().declare_token
            self._declared.append(_declared("a liveliness token", declare, token))


def _declared(what: str, declare: Callable[..., Any], *arguments: Any) -> Any:
    """Declare on Zenoh. Raises SourceError if the session was lost meanwhile."""
    try:
        return declare(*arguments)
    except zenoh.ZError as error:
        raise SourceError(f"{what} cannot be declared: {str(error).split(' at ', 1)[0]}") from None


_ADVICE_SECONDS: Final = 3.0
_RETRY_SECONDS: Final = 0.5
_CHECK_SECONDS: Final = 0.25


class NetworkLink:
    """Keeps a session open; calls `declare` for each new one and `beat` periodically.

    Logs one line when the network is lost and one when it is back, and what does not fit `uses`.
    """

    def __init__(
        self,
        network: Ros2Network,
        node: str,
        declare: Callable[[Ros2Session], None],
        beat: Callable[[], None],
        seconds: float,
        uses: Sequence[TopicUse] = (),
    ) -> None:
        self._network, self._node, self._uses = network, node, uses
        self._declare, self._beat, self._seconds = declare, beat, seconds
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None
        self.state = "not open yet"

    def start(self) -> None:
        """Start connecting."""
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Run the next beat immediately."""
        self._wake.set()

    def close(self) -> None:
        """Leave the network after the last beat."""
        self._stop.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join(5.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                with closing(Ros2Session(self._network, self._node, self._uses)) as session:
                    self._declare(session)
                    self._set_state(
                        "open", f"connected to the ROS 2 network at {self._network.router}"
                    )
                    self._watch(session)
                    # After closing, this last beat sends the stop.
                    self._beat()
            except SourceError as error:
                # After a loss the failed attempts are not logged again.
                if self.state != "lost":
                    self._set_state(str(error), f"{error}; retrying")
                self._stop.wait(_RETRY_SECONDS)

    def _watch(self, session: Ros2Session) -> None:
        """Beat until closed or disconnected."""
        looked = time.monotonic()
        while not self._stop.is_set():
            self._wake.wait(self._seconds)
            # Cleared before the beat: a wake-up during it causes another beat.
            self._wake.clear()
            self._beat()
            if time.monotonic() - looked < _CHECK_SECONDS:
                continue
            looked = time.monotonic()
            session.advise()
            if not session.connected:
                where = f"the ROS 2 network at {self._network.router}"
                self._set_state("lost", f"{where} is lost; retrying")
                return

    def _set_state(self, state: str, line: str) -> None:
        if state != self.state:
            self.state = state
            log(line)
