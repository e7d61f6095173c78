"""How much work a message is, before it is decoded.

To decode a message costs time and memory for each of its values, of which a byte may be one, and
nothing can be stopped that msgpack has begun. To count them costs little, builds nothing, and ends
at the limit.
"""

from __future__ import annotations

from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.wire.limits import Limits, check

ANSWERS: Final = frozenset({"ticked", "evolved"})
LARGE: Final = frozenset({*ANSWERS, "emitted"})
"""Messages that hold events or strings; all others are small."""

_FIXED: Final = {
    0xCA: 5, 0xCB: 9, 0xCC: 2, 0xCD: 3, 0xCE: 5, 0xCF: 9, 0xD0: 2, 0xD1: 3, 0xD2: 5, 0xD3: 9,
    0xD4: 3, 0xD5: 4, 0xD6: 6, 0xD7: 10, 0xD8: 18, 0xDC: 3, 0xDD: 5, 0xDE: 3, 0xDF: 5,
}  # fmt: skip
_LENGTHS: Final = {
    0xC4: (1, 2), 0xC5: (2, 3), 0xC6: (4, 5), 0xC7: (1, 3), 0xC8: (2, 4), 0xC9: (4, 6),
    0xD9: (1, 2), 0xDA: (2, 3), 0xDB: (4, 5),
}  # fmt: skip
"""Bytes of the length, and of the head, of binaries, extensions and texts."""


def _step(first: int) -> int:
    """Bytes up to the next value; 0: its length says it. What is in a list follows its head."""
    if 0xA0 <= first < 0xC0:
        return 1 + (first & 31)
    return 0 if first in _LENGTHS else _FIXED.get(first, 1)


_STEPS: Final = tuple(map(_step, range(256)))
_LISTS: Final = {**dict.fromkeys(range(0x90, 0xA0), 1), 0xDC: 3, 0xDD: 5}
_TEXTS: Final = frozenset({*range(0xA0, 0xC0), 0xD9, 0xDA})


def values_in(data: bytes, most: int) -> int:
    """How many values msgpack bytes have; where more than `most`, one more."""
    place = count = 0
    end, steps = len(data), _STEPS
    while place < end and count <= most:
        step = steps[data[place]]
        place += step or _end(data, place)
        count += 1
    return count


def _end(data: bytes, place: int) -> int:
    width, head = _LENGTHS[data[place]]
    return head + int.from_bytes(data[place + 1 : place + 1 + width], "big")


def name_in(data: bytes) -> str:
    """The name that a message begins with; the empty text where it begins with none."""
    head = _LISTS.get(data[0], 0) if data else 0
    if not head or len(data) <= head or data[head] not in _TEXTS:
        return ""
    first = data[head]
    skipped = _LENGTHS[first][1] if first in _LENGTHS else 1
    size = _STEPS[first] or _end(data, head)
    return data[head + skipped : head + size][:64].decode(errors="replace")


def check_weight(data: bytes, limits: Limits) -> None:
    """Raise ProtocolError where a member's message is more work than it may be."""
    name = name_in(data)
    if len(data) > limits.message_bytes:
        raise ProtocolError(f"{len(data)} bytes at once, over {limits.message_bytes}")
    if not name and len(data) > limits.small_bytes:
        raise ProtocolError("this is no msgpack list that begins with a message's name")
    if name == "emitted":
        check(name, len(data), limits.emitted_bytes, "bytes")
    if name not in LARGE:
        check(name or "a message", len(data), limits.small_bytes, "bytes")
    most = limits.answer_values if name in ANSWERS else limits.values
    if len(data) > most and (count := values_in(data, most)) > most:
        raise ProtocolError(
            f"{name} has at least {count} values, over {most}; send many events or agents in"
            " columns, which are few values"
        )
