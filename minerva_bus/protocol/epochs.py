"""Which coordinator a message is from, or meant for: a number before it.

Whoever coordinates a world later has the higher epoch. A member obeys the highest that has greeted
it, and its answers carry that epoch; so a coordinator that is not the last one any more is neither
obeyed nor answered, and learns that it has been followed.
"""

from __future__ import annotations

import struct
from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.protocol.plain import pack

_WIDTHS: Final = {0xCC: ">B", 0xCD: ">H", 0xCE: ">I", 0xCF: ">Q"}


def stamp(epoch: int) -> bytes:
    """An epoch, from 0, as it stands before a message: a whole number in msgpack."""
    return pack(epoch)


def stamped(data: bytes) -> tuple[int, bytes]:
    """The epoch of a message, and the message. Raises ProtocolError."""
    first = data[0] if data else 0xC1
    if first < 0x80:
        return first, data[1:]
    width = _WIDTHS.get(first)
    if width is None or len(data) <= struct.calcsize(width):
        raise ProtocolError(
            "a message begins with its coordinator's epoch (from protocol 4 on; is the member of"
            " another version of Minerva Bus?)"
        )
    end = 1 + struct.calcsize(width)
    return struct.unpack(width, data[1:end])[0], data[end:]
