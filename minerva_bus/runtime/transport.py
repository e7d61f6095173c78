"""The Zenoh transport: the coordinator's messages as bytes, with one publisher per key."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.runtime.metrics import Metrics
from minerva_bus.wire.codec import encode, stamp
from minerva_bus.wire.keys import Keys, is_name
from minerva_bus.wire.plain import DEFAULT, pack, unpack

_GROUPS: Final = frozenset({s.EVERYONE, s.TICKED, s.HOSTS})

MAX_PUBLISHERS: Final = 4 * DEFAULT.members
"""Publishers that are kept; another one takes the place of the oldest."""

# Most messages of a frame are a tick and the empty replies to it, which differ in the frame only.
# Both sides know their other bytes, because codecs would take several times as many calls.
_FRAME: Final = 1 << 20
_TICK: Final = encode(m.TickRequest(_FRAME)).removesuffix(pack(_FRAME))
_BEFORE_FRAME, _, _AFTER_FRAME = encode(m.TickReply("", _FRAME)).partition(pack(_FRAME))


def encode_reply(message: m.FromMember) -> bytes:
    """A message as bytes, with a short way for an empty reply. Raises ProtocolError."""
    if isinstance(message, m.TickReply) and not message.events and message.saved is None:
        return _BEFORE_FRAME + pack(message.frame) + _AFTER_FRAME
    return encode(message)


def tick_in(data: bytes) -> m.TickRequest | None:
    """A tick; None for what the decoder has to read. Raises ProtocolError."""
    frame = unpack(data[len(_TICK) :]) if data.startswith(_TICK) else None
    return m.TickRequest(frame) if type(frame) is int and frame >= 0 else None


class ZenohTransport:
    """Sends the messages of the coordinator of one epoch; replies arrive later, in its inbox.

    Messages to members wait for room on the link. Views, and frames for observers, are dropped
    when the link is full: a slow observer must not slow down the world.

    `observed` is whether the frames have a subscriber. `has_output`: something was sent, or a
    frame ended, since the flag was last cleared. `ticked` is the last frame whose tick was sent,
    `empty_reply` the bytes of a reply to it without events, and `evolving_since` when its evolution
    was requested. `notify` is called with each message to a single member but views.
    """

    def __init__(
        self,
        keys: Keys,
        epoch: int,
        metrics: Metrics,
        clock: Callable[[], float],
        notify: Callable[[str, m.ToMember], None],
    ) -> None:
        self.epoch = epoch
        self.stamp = stamp(epoch)
        self.observed = self.has_output = False
        self.ticked: int = -1
        self.empty_reply = b""
        self.evolving_since = 0.0
        self._keys = keys
        self._metrics = metrics
        self._clock = clock
        self._notify = notify
        self._publishers: dict[tuple[str, bool], zenoh.Publisher] = {}
        self._keys_to = {s.EVERYONE: keys.all, s.TICKED: keys.tick, s.HOSTS: keys.evolve}

    def open(self, session: zenoh.Session) -> list[Any]:
        """Begin to send over a session; returns the declarations to undeclare at the end."""
        self._session = session
        record = self._publisher(self._keys.record, drops=True)
        return [record.declare_matching_listener(Callback(self._on_observers, indirect=False))]

    def send(self, to: str, message: m.ToMember) -> tuple[()]:
        """Send a message to a member, or to a group."""
        key = self._keys_to.get(to)
        if key is None:
            key = self._keys_to[to] = self._keys.to(to)
        if isinstance(message, m.EvolveRequest):
            # Part 0 is the request to all hosts; later parts repeat some of it.
            if not message.part:
                self.evolving_since = self._clock()
        elif isinstance(message, m.ViewShown):
            # A coupled device must receive every view, unlike observers.
            self._metrics.timed("view", self._put, key, message)
            return ()
        # Refusals and greetings have one recipient; messages to groups need no check.
        elif to not in _GROUPS:
            self._notify(to, message)
        self._put(key, message)
        # After it is sent: members compute already.
        if to == s.TICKED and isinstance(message, m.TickRequest):
            self.ticked = message.frame
            self.empty_reply = self.stamp + encode_reply(m.TickReply("", message.frame))
        return ()

    def show(self, event_type: str, message: m.ToMember, to: str) -> tuple[()]:
        """Publish a view for all observers of its event type, or for one of them."""
        key = self._keys.to(to) if to else self._keys.view(event_type)
        self._metrics.timed("view", self._put, key, message, drops=True)
        return ()

    def publish(self, record: m.FrameRecord) -> None:
        """Publish a frame for observers."""
        data = self._encode(record) if self._metrics.on else encode(record)
        self._publisher(self._keys.record, drops=True).put(data)

    def _put(self, key: str, message: m.ToMember, *, drops: bool = False) -> None:
        data = self._encode(message) if self._metrics.on else encode(message)
        publisher = self._publishers.get((key, drops)) or self._publisher(key, drops=drops)
        publisher.put(self.stamp + data)
        self.has_output = True

    def _encode(self, message: m.ToMember | m.FrameRecord) -> bytes:
        """Encode a message, and measure it."""
        data = self._metrics.timed("encode", encode, message)
        self._metrics.add("bytes out", len(data))
        return data

    def _publisher(self, key: str, *, drops: bool) -> zenoh.Publisher:
        # A key may have two publishers, because congestion control is a property of the publisher:
        # an observer gets views that may be dropped and messages that must not be on one key.
        publisher = self._publishers.get((key, drops))
        if publisher is None:
            if len(self._publishers) >= MAX_PUBLISHERS:
                self._forget_publishers()
            control = zenoh.CongestionControl.DROP if drops else zenoh.CongestionControl.BLOCK
            publisher = self._session.declare_publisher(key, congestion_control=control)
            self._publishers[key, drops] = publisher
        return publisher

    def _forget_publishers(self) -> None:
        """Forget the oldest publishers: guests may come and go under any number of names."""
        record = self._keys.record, True  # Its listener lasts as long as the session.
        oldest = [known for known in self._publishers if known != record][: MAX_PUBLISHERS // 2]
        for known in oldest:
            self._publishers.pop(known).undeclare()
        self._keys_to = {to: self._keys_to[to] for to in _GROUPS}

    def _on_observers(self, status: zenoh.MatchingStatus) -> None:
        self.observed = status.matching


def overhear(
    session: zenoh.Session,
    keys: Keys,
    topics: Collection[str],
    receive: Callable[[str, str, bytes], None],
) -> list[zenoh.Subscriber[Any]]:
    """Subscribe to topics of a world; `*` stands for all of them.

    `receive` is called with topic, publisher and message, in threads of Zenoh.
    """

    def on_sample(sample: zenoh.Sample) -> None:
        topic, member = str(sample.key_expr).split("/")[-2:]
        # A message on a pattern reaches this subscription, too, but is of no topic.
        if is_name(topic) and is_name(member):
            receive(topic, member, sample.payload.to_bytes())

    all_topics = f"{keys.base}/topic/*/*"
    wanted = [all_topics] if "*" in topics else [keys.topic(topic) for topic in sorted(topics)]
    return [session.declare_subscriber(key, Callback(on_sample, indirect=False)) for key in wanted]
