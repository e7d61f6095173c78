"""Encoders and decoders of messages, compiled from declarations (`frame/messages.py`).

Each type of message is compiled once, on first use; encoding or decoding a message then calls one
function per field.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields
from functools import cache
from operator import attrgetter
from typing import Annotated, Any, Final, get_args, get_origin, get_type_hints

import msgpack

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.messages import Mark, Wire
from minerva_bus.wire.field_codec import DeclaredField, FieldCodec, Write
from minerva_bus.wire.fields import field_codec
from minerva_bus.wire.plain import as_map
from minerva_bus.wire.reader import Reader

_EMPTY: Final = frozenset({list, bytes, str, type(None)})
_SHARED: Final = frozenset({tuple, bytes, str, type(None)})
"""Types of empty items, and those of values that several messages can have in common."""

Encode = Callable[[Any], bytes]
Decode = Callable[[Reader, tuple[str, ...], list[Any]], Any]


@dataclass(frozen=True, slots=True)
class MessageCodec:
    """A message's declaration, with the encoder and decoder compiled from it.

    `items`: the fields with an item of their own, in order; `size`: number of items after the name.
    `decode` takes the values of the fields in the key, and the message as a list with its name.
    """

    wire: Wire
    fields: tuple[DeclaredField, ...]
    items: tuple[DeclaredField, ...]
    size: int
    encode: Encode
    decode: Decode


@cache
def message_codec(message: type[Any]) -> MessageCodec:
    """The codec of a declared message. Raises TypeError for an invalid declaration."""
    wire: Wire = message.WIRE
    declared = declared_fields(message)
    # A field within the map of another one has no item of its own.
    items = tuple(of for of in declared if of.travels and not of.host)
    codecs = {of.name: field_codec(of) for of in declared if of.travels}
    encode, decode = _encoder(wire, declared, codecs), _decoder(message, declared, codecs)
    if wire.keyed:
        decode = _keyed_decoder(decode, declared)
    size = 1 if wire.keyed else len(items)
    return MessageCodec(wire, declared, items, size, encode, decode)


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


def _encoder(
    wire: Wire, declared: Sequence[DeclaredField], codecs: Mapping[str, FieldCodec]
) -> Encode:
    """An encoder that reads all attributes in one call and converts those that are not plain."""
    names = [of.name for of in declared if of.travels and not of.host]
    pack, name = msgpack.packb, wire.name
    # A message without items is always the same bytes.
    if not names:
        data = pack([name])
        return lambda _: data
    # For a single name `attrgetter` returns the value itself instead of a tuple.
    if len(names) == 1:
        get, write_one = attrgetter(*names), codecs[names[0]].write
        if write_one is None:
            return lambda message: pack((name, get(message)))
        return lambda message: pack((name, write_one(get(message))))
    values = _values(names, declared, codecs)
    if wire.keyed:
        return lambda message: pack([name, dict(zip(names, values(message), strict=True))])
    return lambda message: pack([name, *values(message)])


def _values(
    names: Sequence[str], declared: Iterable[DeclaredField], codecs: Mapping[str, FieldCodec]
) -> Callable[[Any], list[Any]]:
    """A function that converts several items of a message to plain data."""
    get = attrgetter(*names)
    alone: list[tuple[int, Write]] = []
    hosts: list[tuple[int, Write, attrgetter[Any]]] = []
    for place, name in enumerate(names):
        write, guests = codecs[name].write, [of.name for of in declared if of.host == name]
        if write is not None and guests:
            hosts.append((place, write, attrgetter(name, *guests)))
        elif write is not None:
            alone.append((place, write))

    def values(message: Any) -> list[Any]:
        # One call of `attrgetter` for all attributes: only fields
        # that are not plain cost a call each.
        plain = list(get(message))
        for place, write in alone:
            plain[place] = write(plain[place])
        for place, write, both in hosts:
            plain[place] = write(*both(message))
        return plain

    return values


# --- from plain data ---


def _decoder(
    make: type[Any], declared: Iterable[DeclaredField], codecs: Mapping[str, FieldCodec]
) -> Decode:
    """A decoder that reads an empty list, binary, text or nil only once: most items are empty."""
    travelling = [of for of in declared if of.travels]
    items = [of.name for of in travelling if not of.host]
    plan = [
        (of, 1 + items.index(of.host or of.name), codecs[of.name].read, dict[type[Any], Any]())
        for of in travelling
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
            if not item and value.__class__ in _SHARED and item.__class__ in _EMPTY:
                empties[item.__class__] = value
            values.append(value)
        return make(*key, *values)

    return decode


def _located(error: ProtocolError, of: DeclaredField) -> ProtocolError:
    """The error of a reader of strings or events, prefixed with the message and the field."""
    text = str(error)
    return error if text.startswith(of.message) else ProtocolError(f"{of.what}: {text}")


def _keyed_decoder(decode: Decode, declared: Iterable[DeclaredField]) -> Decode:
    """A decoder of a map. It ignores unknown keys, which a later version may add."""
    travelling = [of for of in declared if of.travels]

    def value(of: DeclaredField, given: Mapping[str, Any]) -> Any:
        if of.name not in given and not of.has(Mark.OPTIONAL):
            raise ProtocolError(f"{of.message} needs {of.name!r}")
        return given.get(of.name, of.default)

    def decode_map(reader: Reader, key: tuple[str, ...], plain: list[Any]) -> Any:
        given = as_map(plain[1], f"the item of {plain[0]}")
        return decode(reader, key, [plain[0], *(value(of, given) for of in travelling)])

    return decode_map
