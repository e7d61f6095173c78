"""Plain data: the values of MessagePack, limits on their number and size, and their types.

The table of limits in section 14 of PROTOCOL.md is generated from this module. Decoding costs time
and memory for each value, a single byte can be a value, and a call of msgpack cannot be
interrupted. So the values of a message are counted before that, which is cheap, allocates nothing
and stops at the limit.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import cache
from typing import Annotated, Any, Final, get_args, get_type_hints

import msgpack

from minerva_bus.errors import MisuseError, ProtocolError
from minerva_bus.frame.collection_step import MAX_WAITING
from minerva_bus.frame.messages import Note, Wire
from minerva_bus.frame.sender_rights import MAX_HOST_EVENTS, MAX_SINGLE_EVENTS
from minerva_bus.grammar.fields import NAME
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.keys import checked_name

# --- limits ---

OF_A_HOST: Final = 8
"""Times as many characters of conditions for a host, whose agents each have their own."""


@fast_dataclass
class Configurable:
    """A limit that a world file may set; `least` is the minimum."""

    least: int


@fast_dataclass
class Limits:
    """Limits of the protocol; a member that sends a message over a limit is rejected.

    A *value* is one item of MessagePack: a list, map, number, text, binary or extension. A column
    is one or a few values for any number of rows. The limits apply to messages of members; the
    notes describe the count of each one.
    """

    message_bytes: Annotated[int, Note("bytes of a message"), Configurable(1024)] = 64 << 20
    # A frame waits for it.
    tick_bytes: Annotated[int, Note("bytes of a `ticked`"), Configurable(1024)] = 8 << 20
    emitted_bytes: Annotated[int, Note("bytes of an `emitted`"), Configurable(1024)] = 4 << 20
    small_bytes: Annotated[
        int,
        Note("bytes of any other message of a member except `ticked` and `evolved`; of a question"),
    ] = 256 << 10
    values: Annotated[
        int,
        Note(
            "values of a message of a member other than `ticked` and `evolved`; of a member's"
            " messages in a second"
        ),
        Configurable(100),
    ] = 50_000
    # A frame waits for these. A generator's saved state may be bytes, which are one value. A host
    # reports changes of all of its agents, newborn agents and views.
    tick_values: Annotated[int, Note("values of a `ticked`"), Configurable(1000)] = 50_000
    answer_values: Annotated[int, Note("values of an `evolved`"), Configurable(1000)] = 400_000
    items: Annotated[int, Note("values of any message, including the coordinator's")] = 64 << 20
    nodes: Annotated[int, Note("symbols of a string; rows of columns")] = 5_000_000
    # Scopes are read without recursion, so this is far beyond Python's own limit.
    depth: Annotated[int, Note("nesting of the scopes of a string")] = 100_000
    # In addition to the limits for bytes and values, because a row of a
    # kind without attributes takes no byte.
    rows: Annotated[int, Note("rows of all columns of a message")] = 20_000_000
    events: Annotated[
        int, Note("events of a `ticked` or `emitted`, including those in columns"), Configurable(1)
    ] = 300_000
    single_events: Annotated[
        int,
        Note(
            "events of a `ticked` or `emitted` that are not in columns; of those of a free-running"
            " generator, in a frame; the weight of all of them, see below"
        ),
        Configurable(1),
    ] = MAX_SINGLE_EVENTS
    host_events: Annotated[
        int,
        Note(
            "events of an `evolved` that are not in columns; agents that it names as senders; the"
            " weight of all of its events"
        ),
        Configurable(1),
    ] = MAX_HOST_EVENTS
    receivers: Annotated[int, Note("receivers of the single events of a `ticked` or `emitted`")] = (
        20_000
    )
    conditions: Annotated[
        int,
        Note(
            "characters of the different conditions of the events of a `ticked` or `emitted`; eight"
            " times as many of an `evolved`"
        ),
    ] = 50_000
    kinds: Annotated[int, Note("kinds of a `hello`")] = 256
    fields: Annotated[int, Note("attributes of all kinds of a `hello`")] = 2_000
    names: Annotated[int, Note("names in each list of a `hello`")] = 1_000
    figures: Annotated[int, Note("figures of a `doing` or `report`")] = 1_000
    messages: Annotated[int, Note("messages of a member in a second"), Configurable(1)] = 5_000
    bytes: Annotated[int, Note("bytes of a member in a second"), Configurable(1024)] = 128 << 20
    seconds: Annotated[
        float, Note("seconds that the coordinator spends in a second on one member's messages")
    ] = 0.25
    stranger_messages: Annotated[
        int, Note("messages of all unknown senders in a second; further ones are only counted")
    ] = 100
    hellos: Annotated[int, Note("`hello`s of a member in a second; changes of its token")] = 20
    all_hellos: Annotated[
        int,
        Note(
            "`hello`s of all members in a second; changes of the tokens of those that take no part"
        ),
    ] = 1_000
    questions: Annotated[
        int, Note("unanswered questions of one sender; further ones get an error")
    ] = 100
    members: Annotated[
        int, Note("members, including expected ones; further ones are not greeted")
    ] = 3_000
    links: Annotated[int, Note("links to the coordinator")] = 4_000
    waiting: Annotated[
        int,
        Note(
            "events of a free-running generator that wait for a frame; those over `single_events`"
            " wait for the next frame, further ones are dropped"
        ),
    ] = MAX_WAITING


def limit_notes() -> Mapping[str, str]:
    """Description of the count behind each limit, by its name."""
    return {name: note.text for name, note in _marks(Note).items()}


@cache  # Decoding asks for each answer.
def configurable_limits() -> Mapping[str, int]:
    """Minimum of each limit that a world file may set, by its name."""
    return {name: mark.least for name, mark in _marks(Configurable).items()}


@cache
def _marks(kind: type[Any]) -> Mapping[str, Any]:
    hints = get_type_hints(Limits, include_extras=True)
    marks = {of.name: get_args(hints[of.name])[1:] for of in fields(Limits)}
    return {name: mark for name, every in marks.items() for mark in every if isinstance(mark, kind)}


DEFAULT: Final = Limits()

ON_DISK: Final = Limits(
    message_bytes=1 << 31,
    tick_bytes=1 << 31,
    emitted_bytes=1 << 31,
    small_bytes=1 << 31,
    values=1 << 31,
    tick_values=1 << 31,
    answer_values=1 << 31,
    # Lower than on the bus: a file may have an unknown origin, and each item takes memory.
    items=16_000_000,
    nodes=50_000_000,
    rows=500_000_000,
    events=100_000_000,
    single_events=100_000_000,
    host_events=100_000_000,
    receivers=1 << 31,
    conditions=1 << 31,
)
"""Limits for files: a message of a record may contain a whole string, from an unknown origin."""


def check(what: str, count: int, most: int, unit: str, advice: str = "") -> None:
    """Raise ProtocolError if a count exceeds a limit; `advice` names an alternative."""
    if count > most:
        raise ProtocolError(f"{what} has {count} {unit}, over {most}{advice and f'; {advice}'}")


# --- the size of a message in values, checked before decoding ---

_FIXED: Final = {
    0xCA: 5, 0xCB: 9, 0xCC: 2, 0xCD: 3, 0xCE: 5, 0xCF: 9, 0xD0: 2, 0xD1: 3, 0xD2: 5, 0xD3: 9,
    0xDC: 3, 0xDD: 5, 0xDE: 3, 0xDF: 5,
}  # fmt: skip
_LENGTHS: Final = {
    0xC4: (1, 2), 0xC5: (2, 3), 0xC6: (4, 5), 0xC7: (1, 3), 0xC8: (2, 4), 0xC9: (4, 6),
    0xD9: (1, 2), 0xDA: (2, 3), 0xDB: (4, 5),
}  # fmt: skip
"""Widths of the length and of the whole head of binaries, extensions and text."""

_FIXED_EXTENSIONS: Final = {0xD4: 1, 0xD5: 2, 0xD6: 4, 0xD7: 8, 0xD8: 16}
_EXTENSIONS: Final = frozenset({0xC7, 0xC8, 0xC9, *_FIXED_EXTENSIONS})
STRING: Final = 2
"""The extension of a string as a value; its content is MessagePack, too."""


_FEW: Final = {
    False: "send many events or agents in columns",
    True: "send many events or agents in columns and save a large state as bytes",
}
"""Advice for a message with too many values, by whether a frame waits for it."""


def _step(first: int) -> int:
    """Bytes up to the next value; 0 for extensions, and where a length field determines it."""
    # Short texts have their length in the first byte.
    if 0xA0 <= first < 0xC0:
        return 1 + (first & 31)
    return 0 if first in _LENGTHS or first in _EXTENSIONS else _FIXED.get(first, 1)


_STEPS: Final = tuple(map(_step, range(256)))
_LISTS: Final = {**dict.fromkeys(range(0x90, 0xA0), 1), 0xDC: 3, 0xDD: 5}
_TEXTS: Final = frozenset({*range(0xA0, 0xC0), 0xD9, 0xDA})


def values_in(data: bytes, most: int) -> int:
    """Number of values in MessagePack data, or `most + 1` if there are more than `most`.

    Those within strings as values count as well, because they are decoded one by one.
    """
    place = count = 0
    steps, ends = _STEPS, [len(data)]
    while ends and count <= most:
        end = ends[-1]
        while place < end and count <= most:
            first = data[place]
            step = steps[first]
            count += 1
            if step:
                place += step
                continue
            begin, after = _content(data, place)
            # A length beyond the end of the data, or of the string around it, ends the loop; the
            # decoder then reports the error.
            if first in _EXTENSIONS and begin <= end and data[begin - 1] == STRING:
                ends.append(min(after, end))
                place = begin
                break
            place = after
        else:
            # What follows a string is counted from its end, whatever its content claims.
            place = ends.pop()
    return count


def _content(data: bytes, place: int) -> tuple[int, int]:
    """Begin and end of the content of a binary, an extension or a text."""
    if data[place] in _FIXED_EXTENSIONS:
        begin = place + 2
        return begin, begin + _FIXED_EXTENSIONS[data[place]]
    width, head = _LENGTHS[data[place]]
    return place + head, place + head + int.from_bytes(data[place + 1 : place + 1 + width], "big")


def name_in(data: bytes, offset: int = 0) -> str:
    """The first item of the list at an offset if it is text, otherwise empty."""
    place = offset + _LISTS.get(data[offset], 0) if len(data) > offset else 0
    if place <= offset or len(data) <= place or data[place] not in _TEXTS:
        return ""
    first = data[place]
    begin, end = _content(data, place) if first in _LENGTHS else (place + 1, place + _STEPS[first])
    return data[begin:end][:64].decode(errors="replace")


def check_weight(data: bytes, wire: Wire, limits: Limits) -> None:
    """Raise ProtocolError if a member's message is larger than its declaration allows."""
    size = len(data)
    # The name is read without decoding, so that the error can mention it.
    name = wire.name or name_in(data)
    if size > limits.message_bytes:
        raise ProtocolError(f"{size} bytes at once, over {limits.message_bytes}")
    most = getattr(limits, wire.max_bytes)
    if size > most:
        if not name:
            raise ProtocolError("this is not a msgpack list that begins with a message's name")
        check(name, size, most, "bytes", raised(wire.max_bytes))
    most = getattr(limits, wire.max_values)
    if size <= most:  # A value has at least one byte.
        return
    if (count := values_in(data, most)) > most:
        raise ProtocolError(
            f"{name or 'a message'} has at least {count} values, over {most}; {_FEW[wire.awaited]},"
            f" which are few values, or raise {wire.max_values} in [limits]"
        )


def raised(limit: str) -> str:
    """Advice to raise a limit, if a world file may set it."""
    return f"raise {limit} in [limits]" if limit in configurable_limits() else ""


def lightest(limits: Limits) -> int:
    """Bytes up to which a message is within all limits, since a value has at least one byte."""
    values = min(limits.values, limits.tick_values, limits.answer_values)
    in_bytes = min(limits.message_bytes, limits.tick_bytes, limits.emitted_bytes)
    return min(in_bytes, limits.small_bytes, values)


# --- MessagePack ---

SLICE: Final = 1 << 18
"""Bytes decoded per call: msgpack holds the GIL for the duration of a call."""

COLLECTED: Final = 1 << 12
"""Messages from this size on are decoded with the garbage collector off: they create many
containers and no garbage, so collections would only cost time."""


def extension(code: int, data: bytes) -> msgpack.ExtType:
    """An extension of MessagePack, without the checks of its constructor, which take longer."""
    return tuple.__new__(msgpack.ExtType, (code, data))  # pyright: ignore[reportUnknownMemberType]


def pack(plain: Any) -> bytes:
    """Encode plain data as MessagePack."""
    # As `msgpack.packb`, which takes twice as long because of its options.
    return msgpack.Packer().pack(plain)


def unpack(data: bytes, limits: Limits = DEFAULT) -> Any:
    """Decode MessagePack: nil, booleans, numbers, text, bytes, lists, maps, extensions.

    Raises ProtocolError for malformed data and for data over `message_bytes` or `items`.
    """
    size = len(data)
    if size > limits.message_bytes:
        raise ProtocolError(f"{size} bytes at once, over {limits.message_bytes}")
    # A value has at least one byte, so shorter data need no count.
    if size > limits.items and values_in(data, limits.items) > limits.items:
        raise ProtocolError("this is not msgpack: too many items")
    # Without a context for a small message: it would take longer than decoding it.
    if size > COLLECTED and gc.isenabled():
        with uncollected():
            return unpack(data, limits)
    try:
        if size > SLICE:
            return _in_slices(data)
        return msgpack.unpackb(data, ext_hook=extension, strict_map_key=True)
    except Exception as error:
        raise ProtocolError(f"this is not msgpack: {type(error).__name__} {error}"[:200]) from None


@contextmanager
def uncollected() -> Generator[None]:
    """Decode without garbage collection, if it is on, a message of more than COLLECTED bytes."""
    # Inside `try`, because an interrupt between the two statements would leave the collector off.
    # Of two threads, the first one to end enables it: the other only becomes slower.
    try:
        gc.disable()
        yield
    finally:
        gc.enable()


def _in_slices(data: bytes) -> Any:
    """Decode large data in slices, so that other threads get the GIL in between."""
    unpacker = msgpack.Unpacker(ext_hook=extension, strict_map_key=True, max_buffer_size=len(data))
    view = memoryview(data)
    for begin in range(0, len(data), SLICE):
        unpacker.feed(view[begin : begin + SLICE])
        try:
            value = unpacker.unpack()
        except msgpack.OutOfData:
            continue
        # A second value after the first would be ignored silently.
        if unpacker.tell() != len(data):
            raise ValueError("data follows the message's end")
        return value
    raise ValueError("it is cut off")


# --- checks of types ---

MAX_SYMBOL: Final = 256
"""Characters of the name of an event type or a kind in a message."""

_TEXT: Final = frozenset({str})


def as_topic(plain: Any, what: str) -> str:
    """`plain` as the name of a sensor topic. Raises ProtocolError."""
    try:
        return checked_name(as_text(plain, what), "a topic")
    except MisuseError as error:
        raise ProtocolError(f"{what}: {error}") from None


def as_event_type(plain: Any, what: str) -> str:
    """`plain` as the name of an event type, or of an agent kind. Raises ProtocolError."""
    name = as_text(plain, what)
    if len(name) > MAX_SYMBOL or not NAME.fullmatch(name):
        raise ProtocolError(
            f"{what}: {name[:MAX_SYMBOL]!r:.100} is not the name of a symbol: use up to"
            f" {MAX_SYMBOL} letters, digits and _, beginning with a letter"
        )
    return name


def on_screen(text: str) -> str:
    """Text from outside with control characters replaced, so that it cannot control a terminal."""
    return "".join([char if char.isprintable() or char in "\t\n" else "?" for char in text])


def as_list(plain: Any, what: str) -> list[Any]:
    """`plain` as a list. Raises ProtocolError."""
    if not isinstance(plain, list):
        raise ProtocolError(f"{what} must be a list, not {name_of(plain)}")
    return plain  # pyright: ignore[reportUnknownVariableType]


def lists_in(items: Iterable[Any]) -> list[list[Any]]:
    """Those items that are lists."""
    return [item for item in items if isinstance(item, list)]


def as_items(plain: Any, what: str, count: int) -> list[Any]:
    """`plain` as a list of `count` items. Raises ProtocolError."""
    items = as_list(plain, what)
    if len(items) != count:
        raise ProtocolError(f"{what} has {count} items, not {len(items)}")
    return items


def as_pairs(plain: Any, what: str) -> list[tuple[Any, Any]]:
    """`plain` as a list of pairs. Raises ProtocolError."""
    pairs = [as_list(item, what) for item in as_list(plain, what)]
    if any(len(pair) != 2 for pair in pairs):
        raise ProtocolError(f"{what} must be pairs")
    return [(first, second) for first, second in pairs]


def as_map(plain: Any, what: str) -> dict[str, Any]:
    """`plain` as a map with text keys. Raises ProtocolError."""
    # Without `cast`, whose calls would take longer than the check of an empty map.
    if not isinstance(plain, dict) or not _TEXT.issuperset(map(type, plain)):  # pyright: ignore
        raise ProtocolError(f"{what} must be a map with text keys, not {name_of(plain)}")
    return plain  # pyright: ignore[reportUnknownVariableType]


def as_text(plain: Any, what: str) -> str:
    """`plain` as text. Raises ProtocolError."""
    if not isinstance(plain, str):
        raise ProtocolError(f"{what} must be text, not {name_of(plain)}")
    return plain


def as_texts(plain: Any, what: str) -> tuple[str, ...]:
    """`plain` as a list of texts. Raises ProtocolError."""
    return tuple([as_text(item, what) for item in as_list(plain, what)])


def as_bytes(plain: Any, what: str) -> bytes:
    """`plain` as bytes. Raises ProtocolError."""
    if not isinstance(plain, bytes):
        raise ProtocolError(f"{what} must be bytes, not {name_of(plain)}")
    return plain


def as_int(plain: Any, what: str, least: int = 0) -> int:
    """`plain` as an int of at least `least`. Raises ProtocolError."""
    if not isinstance(plain, int) or isinstance(plain, bool) or plain < least:
        raise ProtocolError(f"{what} must be a whole number from {least}, not {name_of(plain)}")
    return plain


def as_number(plain: Any, what: str) -> float:
    """`plain` as a finite float. Raises ProtocolError."""
    # nan - nan and inf - inf are nan; an int too large for a float stays exact until float().
    if isinstance(plain, bool) or not isinstance(plain, (int, float)) or plain - plain != 0:
        raise ProtocolError(f"{what} must be a finite number, not {name_of(plain)}")
    return float(plain)


def as_scalar(plain: Any, what: str) -> bool | int | float | str:
    """`plain` as a bool, a finite number or text. Raises ProtocolError."""
    if isinstance(plain, (bool, int, str)) or (isinstance(plain, float) and math.isfinite(plain)):
        return plain
    raise ProtocolError(f"{what} must be a finite number or text, not {name_of(plain)}")


def as_bool(plain: Any, what: str) -> bool:
    """`plain` as a bool. Raises ProtocolError."""
    if not isinstance(plain, bool):
        raise ProtocolError(f"{what} must be true or false, not {name_of(plain)}")
    return plain


def name_of(plain: Any) -> str:
    """A decoded value as error messages describe it: numbers by value, others by type."""
    if isinstance(plain, (bool, int, float)):
        return repr(plain)
    return {"NoneType": "nil", "str": "text", "list": "a list", "dict": "a map"}.get(
        type(plain).__name__, type(plain).__name__
    )
