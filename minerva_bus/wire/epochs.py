"""Which coordinator a message is from, or meant for: a number before it.

Whoever coordinates a world later has the higher epoch. A member obeys the highest that has greeted
it, and its answers carry that epoch; so a coordinator that is not the last one any more is neither
obeyed nor answered, and learns that it has been followed.
"""

from __future__ import annotations

import struct
from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.plain import pack

_ARRAY: Final = (0x90, 0x9F)
"""The first bytes of a short list in msgpack, as each message is one."""

_WIDTHS: Final = {0xCC: ">B", 0xCD: ">H", 0xCE: ">I", 0xCF: ">Q"}


def stamp(epoch: int) -> bytes:
    """An epoch, from 0, as it stands before a message: a whole number in msgpack."""
    return pack(epoch)


def _unstamped(data: bytes) -> str:
    expected = "a message begins with its coordinator's epoch, a whole number in msgpack"
    if data and _ARRAY[0] <= data[0] <= _ARRAY[1]:
        return f"{expected}; this one begins with the message itself, as before protocol 4"
    return f"{expected}, not with {data[:1].hex() or 'nothing'}"


def stamped(data: bytes) -> tuple[int, bytes]:
    """The epoch of a message, and the message. Raises ProtocolError."""
    first = data[0] if data else 0xC1
    if first < 0x80:
        return first, data[1:]
    width = _WIDTHS.get(first)
    if width is None or len(data) <= struct.calcsize(width):
        raise ProtocolError(_unstamped(data))
    end = 1 + struct.calcsize(width)
    return struct.unpack(width, data[1:end])[0], data[end:]
