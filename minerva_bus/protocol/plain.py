"""Plain data: what msgpack knows, and what a message expects of it."""

from __future__ import annotations

import math
from typing import Any, cast

import msgpack

from minerva_bus.errors import ProtocolError
from minerva_bus.protocol.limits import DEFAULT, Limits


def pack(plain: Any) -> bytes:
    """Plain data as msgpack bytes."""
    return msgpack.packb(plain)


def unpack(data: bytes, limits: Limits = DEFAULT) -> Any:
    """What msgpack bytes hold: nil, booleans, numbers, texts, bytes, lists, maps, extensions."""
    if len(data) > limits.message_bytes:
        raise ProtocolError(f"{len(data)} bytes at once, over {limits.message_bytes}")
    counted: dict[str, Any] = {}
    if len(data) > limits.items:  # Else there cannot be so many.
        count = _Count(limits.items)
        most = {"max_array_len": limits.items, "max_map_len": limits.items}
        counted = {"list_hook": count, "object_hook": count, **most}
    try:
        return msgpack.unpackb(data, ext_hook=msgpack.ExtType, strict_map_key=True, **counted)
    except Exception as error:
        raise ProtocolError(f"this is no msgpack: {type(error).__name__} {error}"[:200]) from None


class _Count:
    """Counts the items of lists and maps while they are read, so that few bytes stay little."""

    def __init__(self, most: int) -> None:
        self._left = most

    def __call__(self, plain: Any) -> Any:
        self._left -= len(plain) + 1
        if self._left < 0:
            raise ValueError("too many items")
        return plain


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
