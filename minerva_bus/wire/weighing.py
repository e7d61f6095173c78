"""Size of a message in values, checked before decoding.

Decoding costs time and memory for each value, a single byte can be a value, and a call of msgpack
cannot be interrupted. Counting the values is cheap, allocates nothing and stops at the limit.
"""

from __future__ import annotations

from typing import Final

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.messages import Wire
from minerva_bus.wire.limits import Limits, check, configurable_limits

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
