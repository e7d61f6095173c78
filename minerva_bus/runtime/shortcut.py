"""The two messages of a frame in which nothing happens, without reading and writing them in full.

They are all that most members hear and say in most frames, and nothing in them differs but the
frame's number, which stands last in the one and is repeated in the other. How they look is learnt
from the codec; whatever looks otherwise is the codec's.
"""

from __future__ import annotations

from minerva_bus.frame import messages as m
from minerva_bus.wire.codec import encode
from minerva_bus.wire.plain import pack, unpack

_TICK = encode(m.TickRequest(0)).removesuffix(pack(0))
_NUMBER = len(_TICK)
_BEFORE, _, _AFTER = encode(m.TickReply("", 0)).rpartition(pack(0))


def tick(data: bytes) -> m.TickRequest | None:
    """A tick out of bytes, or None for what has to be read in full. Raises ProtocolError."""
    if not data.startswith(_TICK):
        return None
    frame = unpack(data[_NUMBER:])
    return m.TickRequest(frame) if type(frame) is int and frame >= 0 else None


def nothing_to(tick: bytes) -> bytes:
    """The answer to a tick of a member that has nothing to say, and nothing to save."""
    return _BEFORE + tick[_NUMBER:] + _AFTER


def says_nothing(message: m.FromMember | m.Readings, frame: int) -> bool:
    """Whether a message is that answer."""
    return (
        type(message) is m.TickReply
        and not message.events
        and message.saved is None
        and message.frame == frame
    )
