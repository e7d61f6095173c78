"""Encoding and decoding of every message.

A message is a MessagePack list: its name, then its items in order. Its sender is part of the key on
which it is published. Messages are declared in minerva_bus.frame.messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, get_args

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import Wire
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wire.declared import Encode, MessageCodec, by_name, message_codec
from minerva_bus.wire.limits import DEFAULT, Limits
from minerva_bus.wire.plain import as_list, as_text, uncollected, unpack
from minerva_bus.wire.reader import Reader
from minerva_bus.wire.weighing import check_weight, lightest, name_in

_EMPTY: Final = Vocabulary()

FROM_MEMBER: Final = by_name(get_args(m.FromMember))
TO_MEMBER: Final = by_name(get_args(m.ToMember))
FOR_ALL: Final = by_name((m.Readings, m.FrameRecord))
_READINGS: Final = by_name((m.Readings,))
_RECORD: Final = by_name((m.FrameRecord,))


class _Encoders(dict[type[Any], Encode]):
    """Encoders by type, compiled on first use; a dict is the fastest lookup."""

    def __missing__(self, message: type[Any]) -> Encode:
        self[message] = message_codec(message).encode
        return self[message]


_ENCODERS: Final = _Encoders()
_UNKNOWN: Final = Wire("", ("from",), "an unknown message")


def encode(message: m.Message) -> bytes:
    """A message as bytes. Raises ProtocolError for values that MessagePack cannot represent."""
    try:
        return _ENCODERS[type(message)](message)
    except (TypeError, ValueError, OverflowError) as error:
        what = f"a {type(message).__name__} cannot be sent"
        raise ProtocolError(f"{what}: {type(error).__name__}: {error}"[:200]) from error


def declaration(data: bytes, offset: int = 0) -> Wire:
    """Declaration of the member's message at an offset, found by its name without decoding it."""
    # An unknown message gets the strictest limits until the decoder rejects it.
    codec = FROM_MEMBER.get(name_in(data, offset))
    return _UNKNOWN if codec is None else codec.wire


class Decoder:
    """Decodes messages. Strings and events require the vocabulary of their world.

    Raises only ProtocolError and VocabularyError, for any bytes.
    """

    def __init__(self, vocabulary: Vocabulary = _EMPTY, limits: Limits = DEFAULT) -> None:
        self._reader = Reader(vocabulary, limits)
        # A frame has the events of all members, each of which may send as many as the limit allows.
        self._reader_of_all = Reader(vocabulary, replace(limits, events=limits.rows))
        self._limits = limits
        self._light = lightest(limits)

    def from_member(self, member: str, data: bytes) -> m.FromMember:
        """A message from a member to the coordinator, checked against the limits of its type."""
        return self.decode(FROM_MEMBER, (member,), data, limited=True)

    def to_member(self, data: bytes) -> m.ToMember:
        """A message from the coordinator."""
        return self.decode(TO_MEMBER, (), data)

    def readings(self, topic: str, member: str, data: bytes) -> m.Readings:
        """A member's readings on a topic."""
        return self.decode(_READINGS, (member, topic), data)

    def record(self, data: bytes) -> m.FrameRecord:
        """The record of a frame."""
        return self.decode(_RECORD, (), data)

    def decode(
        self,
        codecs: Mapping[str, MessageCodec],
        key: tuple[str, ...],
        data: bytes,
        *,
        limited: bool = False,
    ) -> Any:
        """A message of one of these types; `key` are the values in the key, such as the sender.

        `limited`: check its size and its number of events against the limits for members.
        """
        try:
            # A message with fewer bytes than every limit cannot exceed one, and most are so small.
            if limited and len(data) > self._light:
                check_weight(data, declaration(data), self._limits)
            with uncollected(len(data)):
                return self._message(codecs, key, data, limited)
        except (ProtocolError, SceneError):
            raise
        except Exception as error:  # Invalid data must raise nothing else.
            kind = type(error).__name__
            raise ProtocolError(f"it cannot be decoded: {kind}: {error}"[:200]) from error

    def _message(
        self,
        codecs: Mapping[str, MessageCodec],
        key: tuple[str, ...],
        data: bytes,
        limited: bool,
    ) -> Any:
        plain = as_list(unpack(data, self._limits), "a message")
        name = as_text(plain[0] if plain else None, "a message's name")
        codec = codecs.get(name)
        if codec is None:
            raise ProtocolError(
                f"no message {name[:40]!r} is sent here; expected {', '.join(codecs)}"
            )
        # A name has one number of items in a version; messages are not distinguished by
        # length (PROTOCOL.md, section 16).
        if len(plain) - 1 != codec.size:
            raise ProtocolError(f"{name} has {codec.size} items, not {len(plain) - 1}")
        # All agents of a host may send an event at once.
        few = limited and codec.wire is not m.EvolveReply.WIRE
        reader = self._reader if few else self._reader_of_all
        reader.columns.begin()
        return codec.decode(reader, key, plain)
