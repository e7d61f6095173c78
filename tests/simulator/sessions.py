"""Simulated Zenoh sessions: subscribers, publishers, queryables and tokens over links."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.runtime.receiver import GONE, HERE
from minerva_bus.runtime.session_inbox import WAKE_UP

if TYPE_CHECKING:
    from tests.simulator.links import Link
    from tests.simulator.network import Network
    from tests.simulator.process import SimulatedProcess

CALLBACK: Final = 5e-6, 300e-6
"""Seconds until a callback with a thread of its own is called."""


@lru_cache(65536)
def matches(pattern: str, key: str) -> bool:
    """Whether two key expressions intersect; both may have `*`, the first a final `**`."""
    ours, theirs = pattern.split("/"), key.split("/")
    if ours[-1] == "**":
        ours, theirs = ours[:-1], theirs[: len(ours) - 1]
    return len(ours) == len(theirs) and all(
        own in ("*", other) or other == "*" for own, other in zip(ours, theirs, strict=True)
    )


@dataclass(frozen=True, slots=True)
class Bytes:
    """A payload."""

    data: bytes = b""

    def __len__(self) -> int:
        return len(self.data)

    def to_bytes(self) -> bytes:
        """Its bytes."""
        return self.data


@dataclass(frozen=True, slots=True)
class Sample:
    """A received message."""

    key_expr: str
    payload: Bytes
    kind: Any


class Query:
    """A query, which is answered at most once."""

    def __init__(
        self, key: str, data: bytes, answer: Callable[[bytes], None], session: bytes = b""
    ) -> None:
        self.key_expr = key
        self.payload, self.attachment = Bytes(data), Bytes(session)
        self._answer = answer

    def __enter__(self) -> Query:
        return self

    def __exit__(self, *_: object) -> None:
        return

    def reply(self, key: str, data: bytes) -> None:
        """Answer it."""
        self._answer(data)


class Channel:
    """Received messages of a process; reading an empty one returns a spurious wake-up."""

    def __init__(self, process: SimulatedProcess, pattern: str) -> None:
        self._process = process
        self._queue: deque[Sample] = deque()
        self._spurious = Sample(pattern.replace("*", "coordinator"), Bytes(WAKE_UP), HERE)

    def put(self, sample: Sample) -> None:
        """Add a message."""
        self._queue.append(sample)
        self._process.wake()

    def recv(self) -> Sample:
        """The next message."""
        if self._queue:
            return self._queue.popleft()
        # No turn runs until a message arrives; a spurious wake-up lets the caller continue.
        self._process.block()
        return self._spurious

    def try_recv(self) -> Sample | None:
        """The next message, or None."""
        return self._queue.popleft() if self._queue else None

    def undeclare(self) -> None:
        """Remove the subscription."""
        self._queue.clear()


@dataclass(slots=True)
class Declared:
    """A declared subscription; `undo` removes it."""

    pattern: str
    hear: Callable[[Any], None]
    session: Session
    undo: Callable[[Declared], None]

    def undeclare(self) -> None:
        """Remove the subscription."""
        self.undo(self)


class DeclaredChannel(Declared):
    """A declared subscription with a channel."""

    channel: Channel

    def recv(self) -> Sample:
        """The next message."""
        return self.channel.recv()

    def try_recv(self) -> Sample | None:
        """The next message, or None."""
        return self.channel.try_recv()


@dataclass(slots=True)
class Token:
    """A liveliness token."""

    key: str
    session: Session

    def undeclare(self) -> None:
        """Remove the token."""
        self.session.drop_token(self)


@dataclass(frozen=True, slots=True)
class Matching:
    """Whether a publisher has subscribers, which need not be known to publish."""

    matching: bool = True


@dataclass(slots=True)
class Publisher:
    """Publishes on one key, `here`, `elsewhere` or both; what is `droppable` may be lost."""

    session: Session
    key: str
    here: bool
    elsewhere: bool
    droppable: bool
    matching_status: Matching = Matching()

    def put(self, data: bytes) -> None:
        """Publish a payload."""
        if self.here:
            self.session.hear(self.key, data)
        if self.elsewhere:
            self.session.publish(self.key, data, droppable=self.droppable)

    def declare_matching_listener(self, _: Any) -> Publisher:
        """Do nothing: records of frames have no observers here."""
        return self

    def undeclare(self) -> None:
        """Remove the publisher."""


@dataclass(slots=True)
class Session:
    """Session of a process: the hub's, or a client's with its `link` to the hub, if any."""

    network: Network
    process: SimulatedProcess
    hub: bool
    link: Link | None = None
    subscribers: list[Declared] = field(default_factory=list[Declared])
    queryables: list[Declared] = field(default_factory=list[Declared])
    watches: list[Declared] = field(default_factory=list[Declared])
    tokens: list[Token] = field(default_factory=list[Token])
    known: dict[str, None] = field(default_factory=dict[str, None])
    """Visible tokens of other sessions, for a client."""

    # --- the interface of Zenoh's sessions ---

    def declare_subscriber(self, key: str, handler: Any) -> Declared:
        """Subscribe with a callback or a channel."""
        declared = self._declared(key, handler, self.subscribers)
        self.network.changed(self)
        return declared

    def declare_publisher(self, key: str, **options: Any) -> Publisher:
        """Publish on a key."""
        allowed = str(options.get("allowed_destination"))
        here, elsewhere = "REMOTE" not in allowed, "SESSION_LOCAL" not in allowed
        droppable = "DROP" in str(options.get("congestion_control"))
        return Publisher(self, key, here, elsewhere, droppable)

    def declare_queryable(self, key: str, handler: Any) -> Declared:
        """Declare a queryable."""
        return self._declared(key, handler, self.queryables)

    def liveliness(self) -> Liveliness:
        """The liveliness interface."""
        return Liveliness(self)

    def close(self) -> None:
        """Close the session."""
        self.network.leave(self)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- implementation ---

    def _declared(self, key: str, handler: Any, among: list[Declared]) -> Declared:
        call = getattr(handler, "callback", None)
        if call is None:
            channel = Channel(self.process, key)
            declared = DeclaredChannel(key, channel.put, self, among.remove)
            declared.channel = channel
        else:
            hear = self._by_thread(call) if handler.indirect else call
            declared = Declared(key, hear, self, among.remove)
        among.append(declared)
        return declared

    def _by_thread(self, call: Callable[[Any], None]) -> Callable[[Any], None]:
        """A callback as from Zenoh's thread: in order, but later than a channel."""
        timeline, process = self.process.timeline, self.process
        chance, last = timeline.stream(f"callbacks of {process.name}"), [0.0]

        def hear(item: Any) -> None:
            # At equal times calls keep their order, so callbacks do, too.
            last[0] = max(last[0], timeline.now + chance.uniform(*CALLBACK))
            timeline.at(last[0], lambda: process.system.call(lambda: call(item)))

        return hear

    def watch(self, key: str, handler: Any, history: bool) -> Declared:
        """Watch tokens, including the present ones."""
        declared = self._declared(key, handler, self.watches)
        if history:
            self.network.tokens.report(self, declared)
        return declared

    def take_token(self, key: str) -> Token:
        """Declare a token."""
        token = Token(key, self)
        self.tokens.append(token)
        self.network.tokens.declare(self, key, there=True)
        return token

    def drop_token(self, token: Token) -> None:
        """Remove a token."""
        self.tokens.remove(token)
        self.network.tokens.declare(self, token.key, there=False)

    def publish(self, key: str, data: bytes, *, droppable: bool) -> None:
        """Publish to all subscribers of other processes."""
        self.network.publish(self, key, data, droppable=droppable)

    def hear(self, key: str, data: bytes) -> None:
        """Deliver a message."""
        sample = Sample(key, Bytes(data), HERE)
        # A copy, because a callback may add or remove subscriptions.
        for subscriber in list(self.subscribers):
            if matches(subscriber.pattern, key):
                subscriber.hear(sample)

    def see(self, key: str, *, there: bool) -> None:
        """Deliver a change of a token."""
        sample = Sample(key, Bytes(), HERE if there else GONE)
        for watch in list(self.watches):
            if matches(watch.pattern, key):
                watch.hear(sample)


class Liveliness:
    """Liveliness of a session."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def declare_token(self, key: str) -> Token:
        """Declare a token."""
        return self._session.take_token(key)

    def declare_subscriber(self, key: str, handler: Any, *, history: bool) -> Declared:
        """Subscribe to tokens."""
        return self._session.watch(key, handler, history)

    def get(self, key: str, *, timeout: float) -> list[str]:
        """Matching tokens according to the hub, without delay."""
        return self._session.network.tokens.matching(self._session, key)
