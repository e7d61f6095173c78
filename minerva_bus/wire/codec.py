"""Encoding and decoding of every message.

A message is a MessagePack list: its name, then its items in order. Its sender is part of the key on
which it is published. Messages are declared in `frame/messages.py`; each type is compiled once, on
first use, and encoding or decoding a message then calls one function per field.

An epoch is the number in front of each message that identifies the coordinator. Each successor has
a higher one, like a fencing token. A member follows the highest epoch that has greeted it and
stamps its replies with it. It therefore ignores a coordinator that has been replaced, and that
coordinator detects its successor.
"""

from __future__ import annotations

import gc
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, replace
from functools import cache
from operator import attrgetter
from typing import Annotated, Any, Final, get_args, get_origin, get_type_hints

from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.frame import messages as m
from minerva_bus.frame.messages import Mark, Wire
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wire.field_codecs import DeclaredField, FieldCodec, field_codec
from minerva_bus.wire.plain import (
    COLLECTED,
    DEFAULT,
    Limits,
    as_list,
    as_map,
    as_text,
    check_weight,
    lightest,
    name_in,
    pack,
    uncollected,
    unpack,
)
from minerva_bus.wire.strings_codec import Reader

# --- epochs ---

_ARRAY: Final = (0x90, 0x9F)
"""Range of the first byte of a short MessagePack list, which every message is."""

_WIDTHS: Final = {0xCC: ">B", 0xCD: ">H", 0xCE: ">I", 0xCF: ">Q"}


def stamp(epoch: int) -> bytes:
    """The prefix of messages of an epoch: a MessagePack integer from 0 in its shortest form."""
    return pack(epoch)


def _unstamped(data: bytes) -> str:
    expected = "a message begins with its coordinator's epoch, a whole number in msgpack"
    if data and _ARRAY[0] <= data[0] <= _ARRAY[1]:
        return f"{expected}; this one begins with the message itself, as before protocol 4"
    return f"{expected}, not with {data[:1].hex() or 'nothing'}"


def stamped(data: bytes) -> tuple[int, bytes]:
    """Split data into the epoch and the message. Raises ProtocolError."""
    # MessagePack never uses 0xC1, so empty data are rejected like any other wrong first byte.
    first = data[0] if data else 0xC1
    if first < 0x80:
        return first, data[1:]
    width = _WIDTHS.get(first)
    if width is None or len(data) <= struct.calcsize(width):
        raise ProtocolError(_unstamped(data))
    end = 1 + struct.calcsize(width)
    return struct.unpack(width, data[1:end])[0], data[end:]


# --- codecs of declared messages ---

_EMPTY_TYPES: Final = frozenset({list, bytes, str, type(None)})
_SHARED: Final = frozenset({tuple, bytes, str, type(None)})
"""Types of empty items, and those of values that several messages can have in common."""

Encode = Callable[[Any], bytes]
Decode = Callable[[Reader, tuple[str, ...], list[Any]], Any]


@dataclass(frozen=True, slots=True)
class MessageCodec:
    """A message's declaration, with the encoder and decoder compiled from it.

    `items`: the fields that are sent, in order; `size`: number of items after the name.
    `decode` takes the values of the fields in the key, and the message as a list with its name.
    """

    wire: Wire
    items: tuple[DeclaredField, ...]
    size: int
    encode: Encode
    decode: Decode


@cache
def message_codec(message: type[Any]) -> MessageCodec:
    """The codec of a declared message. Raises TypeError for an invalid declaration."""
    wire: Wire = message.WIRE
    declared = declared_fields(message)
    items = tuple([of for of in declared if of.travels])
    codecs = [field_codec(of) for of in items]
    encode, decode = _encoder(wire, items, codecs), _decoder(message, items, codecs)
    if wire.keyed:
        decode = _keyed_decoder(decode, items)
    size = 1 if wire.keyed else len(items)
    return MessageCodec(wire, items, size, encode, decode)


def by_name(messages: Iterable[type[Any]]) -> Mapping[str, MessageCodec]:
    """Codecs of these messages, by their names on the wire."""
    codecs = map(message_codec, messages)
    return {codec.wire.name: codec for codec in codecs}


def declared_fields(message: type[Any]) -> tuple[DeclaredField, ...]:
    """The fields of a message: those in the key, then those sent, then local ones.

    Raises TypeError for any other order, because decoding creates the message by position.
    """
    hints = get_type_hints(message, include_extras=True)
    declared = tuple(_declared(message.WIRE.name, of, hints[of.name]) for of in fields(message))
    ranks = [0 if of.has(Mark.FROM_KEY) else 1 if of.travels else 2 for of in declared]
    if ranks != sorted(ranks):
        raise TypeError(f"{message.__name__}: fields of the key come first, local ones last")
    return declared


def _declared(message: str, of: Field[Any], hint: Any) -> DeclaredField:
    marks: tuple[object, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *extras = get_args(hint)
        marks = tuple(extras)
    default = None if of.default is MISSING else of.default
    return DeclaredField(message, of.name, hint, marks, default)


# --- to bytes ---


def _encoder(wire: Wire, items: Sequence[DeclaredField], codecs: Sequence[FieldCodec]) -> Encode:
    """An encoder that reads all attributes in one call and converts those that are not plain."""
    names, name = [of.name for of in items], wire.name
    # A message without items is always the same bytes.
    if not names:
        data = pack([name])
        return lambda _: data
    get = attrgetter(*names)
    # For a single name `attrgetter` returns the value itself instead of a tuple.
    if len(names) == 1:
        write_one = codecs[0].write
        if write_one is None:
            return lambda message: pack((name, get(message)))
        return lambda message: pack((name, write_one(get(message))))
    writes = [(place, of.write) for place, of in enumerate(codecs) if of.write is not None]

    def encode_items(message: Any) -> bytes:
        # One call of `attrgetter` for all attributes: only fields
        # that are not plain cost a call each.
        plain = list(get(message))
        for place, write in writes:
            plain[place] = write(plain[place])
        return pack([name, dict(zip(names, plain, strict=True))] if wire.keyed else [name, *plain])

    return encode_items


# --- from plain data ---


def _decoder(
    make: type[Any], items: Sequence[DeclaredField], codecs: Sequence[FieldCodec]
) -> Decode:
    """A decoder that reads an empty list, binary, text or nil only once: most items are empty."""
    plan = [
        (of, place, codec.read, dict[type[Any], Any]())
        for place, (of, codec) in enumerate(zip(items, codecs, strict=True), 1)
    ]

    def decode(reader: Reader, key: tuple[str, ...], plain: list[Any]) -> Any:
        values: list[Any] = []
        for of, place, read, empties in plan:
            item = plain[place]
            if not item and item.__class__ in empties:
                values.append(empties[item.__class__])
                continue
            try:
                value = read(reader, item)
            # Readers of values do not have the name of the field, so the place is added here.
            except ProtocolError as error:
                raise _located(error, of) from None
            # An empty map is a new object each time.
            if not item and value.__class__ in _SHARED and item.__class__ in _EMPTY_TYPES:
                empties[item.__class__] = value
            values.append(value)
        return make(*key, *values)

    return decode


def _located(error: ProtocolError, of: DeclaredField) -> ProtocolError:
    """The error of a reader of strings or events, prefixed with the message and the field."""
    text = str(error)
    return error if text.startswith(of.message) else ProtocolError(f"{of.what}: {text}")


def _keyed_decoder(decode: Decode, items: Sequence[DeclaredField]) -> Decode:
    """A decoder of a map. It ignores unknown keys, which a later version may add."""

    def value(of: DeclaredField, given: Mapping[str, Any]) -> Any:
        if of.name not in given and not of.has(Mark.OPTIONAL):
            raise ProtocolError(f"{of.message} needs {of.name!r}")
        return given.get(of.name, of.default)

    def decode_map(reader: Reader, key: tuple[str, ...], plain: list[Any]) -> Any:
        given = as_map(plain[1], f"the item of {plain[0]}")
        return decode(reader, key, [plain[0], *(value(of, given) for of in items)])

    return decode_map


# --- any message ---

_NO_SYMBOLS: Final = Vocabulary()

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

    def __init__(self, vocabulary: Vocabulary = _NO_SYMBOLS, limits: Limits = DEFAULT) -> None:
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
            if len(data) > COLLECTED and gc.isenabled():
                with uncollected():
                    return self.decode(codecs, key, data, limited=limited)
            plain = unpack(data, self._limits)
            # The usual case without a call for each check.
            name = plain[0] if plain.__class__ is list and plain else None
            codec = codecs.get(name) if isinstance(name, str) else None
            # A name has one number of items in a version; messages are not distinguished by
            # length (PROTOCOL.md, section 16).
            if codec is None or len(plain) != 1 + codec.size:
                raise _misfit(plain, codecs)
            # All agents of a host may send an event at once.
            few = limited and codec.wire is not m.EvolveReply.WIRE
            reader = self._reader if few else self._reader_of_all
            reader.begin()
            return codec.decode(reader, key, plain)
        except (ProtocolError, SceneError):
            raise
        except Exception as error:  # Invalid data must raise nothing else.
            kind = type(error).__name__
            raise ProtocolError(f"it cannot be decoded: {kind}: {error}"[:200]) from error


def _misfit(plain: Any, codecs: Mapping[str, MessageCodec]) -> ProtocolError:
    """Why plain data are none of these messages. Raises ProtocolError if they are no message."""
    items = as_list(plain, "a message")
    name = as_text(items[0] if items else None, "a message's name")
    if name not in codecs:
        return ProtocolError(f"no message {name[:40]!r} is sent here; expected {', '.join(codecs)}")
    return ProtocolError(f"{name} has {codecs[name].size} items, not {len(items) - 1}")
