"""A member's messages as bytes: with the current coordinator, and on sensor topics."""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, cast

import zenoh

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.runtime.world_log import Restraint
from minerva_bus.wire.codec import Decoder, encode, stamp, stamped
from minerva_bus.wire.keys import Keys


class WorldLink:
    """Encodes and decodes the messages of one member.

    The current coordinator is the one of the highest epoch that has greeted, rejected or stopped
    this member. `stamp` is its epoch as bytes, empty before that. `unsent` counts events
    that no coordinator received.
    """

    def __init__(
        self, keys: Keys, member: str, notify: Callable[[str], None], clock: Callable[[], float]
    ) -> None:
        self.keys = keys
        self.stamp = b""
        self.unsent: int = 0
        self._member = member
        self._notify = notify
        self._clock = clock
        self._epoch = -1
        self._decoder = Decoder()
        self._joined = False
        self._restraint = Restraint()
        self._topics = f"{keys.base}/topic/"
        self._publishers: dict[str, zenoh.Publisher] = {}

    def open(self, session: zenoh.Session, topics: Iterable[str]) -> list[Any]:
        """Declare publishers for the coordinator and for topics; returns the declarations."""
        keys, member = self.keys, self._member
        self._replies = _publisher(session, keys.sent_by(member))
        for topic in topics:
            # Members of this process get readings without encoding.
            self._publishers[topic] = session.declare_publisher(
                keys.topic(topic, member),
                congestion_control=zenoh.CongestionControl.BLOCK,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        return [self._replies, *self._publishers.values()]

    def send(self, message: m.FromMember | m.Readings) -> None:
        """Send a message; before a coordinator's greeting it has no recipient and is dropped.

        Readings go to other processes, and are not even encoded if none subscribes to them.
        """
        if isinstance(message, m.Readings):
            publisher = self._publishers[message.topic]
            # The stub has another type.
            if cast("Any", publisher).matching_status.matching:
                publisher.put(encode(message))
        # Read once: a generator's thread sends, too, while the main thread may lose the connection.
        elif epoch := self.stamp:
            self._replies.put(epoch + encode(message))
        else:
            # Only events are lost: replies belong to a frame that is requested again.
            self.unsent += isinstance(message, m.Emitted)

    def joined(self, vocabulary: Vocabulary) -> None:
        """Note that the member has joined: from now on messages may contain the world's symbols."""
        self._decoder, self._joined = Decoder(vocabulary), True

    def lost(self) -> None:
        """Note that the connection is lost: ignore coordinators until one greets again."""
        if self.stamp:
            # The same coordinator may greet again: its epoch must count as a later one then.
            self._epoch, self.stamp = self._epoch - 1, b""

    def message(self, data: bytes) -> m.ToMember | None:
        """The coordinator's message; None for one that must be ignored.

        Raises ProtocolError and SceneError for a message that cannot be decoded: a member that has
        missed one can no longer take part.
        """
        # The usual case, decided without decoding the epoch.
        if self.stamp and data.startswith(self.stamp):
            body = data[len(self.stamp) :]
        elif (body := self._first_of_epoch(data)) is None:
            return None
        try:
            return self._decoder.to_member(body)
        except (ProtocolError, SceneError):
            if self._joined:
                raise
            return None  # Without the vocabulary, messages with symbols cannot be decoded.

    def is_topic(self, key: str) -> bool:
        """Whether readings arrive on a key."""
        return key.startswith(self._topics)

    def readings(self, key: str, data: bytes) -> m.Readings | None:
        """The readings that arrived on the key of a topic; None if they cannot be decoded."""
        topic, publisher = key.split("/")[3:5]
        try:
            return self._decoder.readings(topic, publisher, data)
        except (ProtocolError, SceneError) as error:
            if self._joined:
                self._drop(publisher, str(error))
            return None

    def _first_of_epoch(self, data: bytes) -> bytes | None:
        """The message of a later coordinator without its epoch, if it concerns this member."""
        try:
            epoch, body = stamped(data)
            # A coordinator that has been replaced may still be sending,
            # for example after it was frozen.
            if epoch <= self._epoch:
                return None
            # Decoded before the epoch is accepted: bytes that are not a message
            # must not displace a coordinator.
            message = self._decoder.to_member(body)
        except (ProtocolError, SceneError):
            return None
        # Other messages concern a membership that this member does not have with that coordinator.
        if not isinstance(message, m.Greet | m.Refused | m.Stop):
            return None
        self._epoch, self.stamp = epoch, stamp(epoch)
        return body

    def _drop(self, publisher: str, error: str) -> None:
        """Report readings that cannot be read, at a limited rate per publisher."""
        now = self._clock()
        for who, text in self._restraint.left_out(now):
            self._notify(f"{self._member}: from {who}: {text}")
        if self._restraint.lets(publisher, now):
            self._notify(f"{self._member}: from {publisher}: {error}; dropped")


def _publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
