"""Epochs: the number in front of each message that identifies the coordinator.

Each successor of a coordinator has a higher epoch, like a fencing token. A member follows the
highest epoch that has greeted it and stamps its replies with it. It therefore ignores a coordinator
that has been replaced, and that coordinator detects its successor.
"""

from __future__ import annotations

import struct
from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.plain import pack

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
