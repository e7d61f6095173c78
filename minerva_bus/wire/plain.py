"""Plain data: the values of MessagePack, and checks of their types."""

from __future__ import annotations

import gc
import math
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, Final, cast

import msgpack

from minerva_bus.errors import MisuseError, ProtocolError
from minerva_bus.grammar.fields import NAME
from minerva_bus.wire.keys import checked_name
from minerva_bus.wire.message_limits import DEFAULT, Limits, values_in

SLICE: Final = 1 << 18
"""Bytes decoded per call: msgpack holds the GIL for the duration of a call."""

MAX_SYMBOL: Final = 256
"""Characters of the name of an event type or a kind in a message."""

_TEXT: Final = frozenset({str})

COLLECTED: Final = 1 << 12
"""Messages from this size on are decoded with the garbage collector off: they create many
containers and no garbage, so collections would only cost time."""

_AS_USUAL: Final = nullcontext()


def extension(code: int, data: bytes) -> msgpack.ExtType:
    """An extension of MessagePack, without the checks of its constructor, which take longer."""
    return tuple.__new__(msgpack.ExtType, (code, data))  # pyright: ignore[reportUnknownMemberType]


def pack(plain: Any) -> bytes:
    """Encode plain data as MessagePack."""
    return msgpack.packb(plain)


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
    try:
        with uncollected(size):
            return _unpacked(data)
    except Exception as error:
        raise ProtocolError(f"this is not msgpack: {type(error).__name__} {error}"[:200]) from None


def uncollected(size: int) -> AbstractContextManager[None]:
    """Decode a message of `size` bytes without garbage collection if it is large."""
    return _uncollected() if size > COLLECTED else _AS_USUAL


@contextmanager
def _uncollected() -> Generator[None]:
    paused = gc.isenabled()
    # Inside `try`, because an interrupt between the two statements would leave the collector off.
    # Of two threads, the first one to end enables it: the other only becomes slower.
    try:
        if paused:
            gc.disable()
        yield
    finally:
        if paused:
            gc.enable()


def _unpacked(data: bytes) -> Any:
    """Decode large data in slices, so that other threads get the GIL in between."""
    if len(data) <= SLICE:
        return msgpack.unpackb(data, ext_hook=extension, strict_map_key=True)
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
    return cast("list[Any]", plain)


def as_pairs(plain: Any, what: str) -> list[tuple[Any, Any]]:
    """`plain` as a list of pairs. Raises ProtocolError."""
    pairs = [as_list(item, what) for item in as_list(plain, what)]
    if any(len(pair) != 2 for pair in pairs):
        raise ProtocolError(f"{what} must be pairs")
    return [(first, second) for first, second in pairs]


def as_map(plain: Any, what: str) -> dict[str, Any]:
    """`plain` as a map with text keys. Raises ProtocolError."""
    if not isinstance(plain, dict) or not _TEXT.issuperset(map(type, cast(Any, plain))):
        raise ProtocolError(f"{what} must be a map with text keys, not {name_of(plain)}")
    return cast("dict[str, Any]", plain)


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
    if isinstance(plain, bool) or not isinstance(plain, int | float) or plain - plain != 0:
        raise ProtocolError(f"{what} must be a finite number, not {name_of(plain)}")
    return float(plain)


def as_scalar(plain: Any, what: str) -> bool | int | float | str:
    """`plain` as a bool, a finite number or text. Raises ProtocolError."""
    if isinstance(plain, bool | int | str) or (isinstance(plain, float) and math.isfinite(plain)):
        return plain
    raise ProtocolError(f"{what} must be a finite number or text, not {name_of(plain)}")


def as_bool(plain: Any, what: str) -> bool:
    """`plain` as a bool. Raises ProtocolError."""
    if not isinstance(plain, bool):
        raise ProtocolError(f"{what} must be true or false, not {name_of(plain)}")
    return plain


def name_of(plain: Any) -> str:
    """A decoded value as error messages describe it: numbers by value, others by type."""
    if isinstance(plain, bool | int | float):
        return repr(plain)
    return {"NoneType": "nil", "str": "text", "list": "a list", "dict": "a map"}.get(
        type(plain).__name__, type(plain).__name__
    )
