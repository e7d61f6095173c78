"""Plain data: what msgpack knows, and what a message expects of it."""

from __future__ import annotations

import gc
import math
from typing import Any, Final, cast

import msgpack

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.limits import DEFAULT, Limits
from minerva_bus.wire.weighing import values_in

SLICE: Final = 1 << 18
"""Bytes that msgpack reads at once: it holds Python's lock for as long."""

COLLECTED: Final = 1 << 16
"""Bytes from which on a message is built without a look for garbage, which it has none of."""


def pack(plain: Any) -> bytes:
    """Plain data as msgpack bytes."""
    return msgpack.packb(plain)


def unpack(data: bytes, limits: Limits = DEFAULT) -> Any:
    """What msgpack bytes hold: nil, booleans, numbers, texts, bytes, lists, maps, extensions."""
    if len(data) > limits.message_bytes:
        raise ProtocolError(f"{len(data)} bytes at once, over {limits.message_bytes}")
    if len(data) > limits.items and values_in(data, limits.items) > limits.items:
        raise ProtocolError("this is no msgpack: too many items")
    collected = len(data) > COLLECTED and gc.isenabled()
    if collected:
        gc.disable()
    try:
        return _unpacked(data)
    except Exception as error:
        raise ProtocolError(f"this is no msgpack: {type(error).__name__} {error}"[:200]) from None
    finally:
        if collected:
            gc.enable()


def _unpacked(data: bytes) -> Any:
    """What bytes hold; of many, one part after another, so that other threads have their turns."""
    if len(data) <= SLICE:
        return msgpack.unpackb(data, ext_hook=msgpack.ExtType, strict_map_key=True)
    unpacker = msgpack.Unpacker(
        ext_hook=msgpack.ExtType, strict_map_key=True, max_buffer_size=len(data)
    )
    view = memoryview(data)
    for begin in range(0, len(data), SLICE):
        unpacker.feed(view[begin : begin + SLICE])
        try:
            found = unpacker.unpack()
        except msgpack.OutOfData:
            continue
        if unpacker.tell() != len(data):
            raise ValueError("there is more behind its end")
        return found
    raise ValueError("it is cut off")


def on_screen(text: str) -> str:
    """A text that somebody else has chosen, as a terminal may have it: without what steers one."""
    return "".join([one if one.isprintable() or one in "\t\n" else "?" for one in text])


def listed(plain: Any, what: str) -> list[Any]:
    """A list. Raises ProtocolError."""
    if not isinstance(plain, list):
        raise ProtocolError(f"{what} must be a list, not {name_of(plain)}")
    return cast("list[Any]", plain)


def mapped(plain: Any, what: str) -> dict[str, Any]:
    """A map with texts for keys. Raises ProtocolError."""
    if not isinstance(plain, dict) or not all(isinstance(k, str) for k in cast(Any, plain)):
        raise ProtocolError(f"{what} must be a map by names, not {name_of(plain)}")
    return cast("dict[str, Any]", plain)


def text(plain: Any, what: str) -> str:
    """A text. Raises ProtocolError."""
    if not isinstance(plain, str):
        raise ProtocolError(f"{what} must be a text, not {name_of(plain)}")
    return plain


def whole(plain: Any, what: str, least: int = 0) -> int:
    """A whole number, not under `least`. Raises ProtocolError."""
    if not isinstance(plain, int) or isinstance(plain, bool) or plain < least:
        raise ProtocolError(f"{what} must be a whole number from {least}, not {name_of(plain)}")
    return plain


def number(plain: Any, what: str) -> float:
    """A finite number. Raises ProtocolError."""
    if isinstance(plain, bool) or not isinstance(plain, int | float) or plain - plain != 0:
        raise ProtocolError(f"{what} must be a finite number, not {name_of(plain)}")
    return float(plain)


def figure(plain: Any, what: str) -> bool | int | float | str:
    """Something for people to look at. Raises ProtocolError."""
    plainly = isinstance(plain, bool | int | str)
    if not plainly and not (isinstance(plain, float) and math.isfinite(plain)):
        raise ProtocolError(f"{what} must be a finite number or a text, not {name_of(plain)}")
    return plain


def truth(plain: Any, what: str) -> bool:
    """True or false. Raises ProtocolError."""
    if not isinstance(plain, bool):
        raise ProtocolError(f"{what} must be true or false, not {name_of(plain)}")
    return plain


def name_of(plain: Any) -> str:
    """What a message has in a place where something else was expected."""
    if isinstance(plain, bool | int | float):
        return repr(plain)
    return {"NoneType": "nil", "str": "a text", "list": "a list", "dict": "a map"}.get(
        type(plain).__name__, type(plain).__name__
    )
