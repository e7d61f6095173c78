"""The messages of a record that replay exactly, as msgpack.

    frame  = ["frame", number, [event, ...], edit, digest]
    string = ["string", number, string]

Events and strings are those of the bus (protocol/values.py), an edit is in edits.py. The edit is
of the string that the last frame before this one in the record has left; the digest, 16 bytes, is
that of the string after it. A `string` is what the frame of this number begins with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.description import LIMITS
from minerva_bus.log.edits import Edit
from minerva_bus.wire.plain import as_int, as_list, pack, unpack
from minerva_bus.wire.values import Reader, plain_event, plain_scene


@dataclass(frozen=True, slots=True)
class Frame:
    """What happened in a frame, as it was recorded.

    `events` are in their order; `digest` is that of the string after the frame; `seconds` is when
    it was over, since the record began, by the clock.
    """

    number: int
    events: tuple[AnyEvent, ...]
    edit: Edit
    digest: bytes
    seconds: float


def encode_frame(number: int, events: Sequence[AnyEvent], edit: Edit, digest: bytes) -> bytes:
    """A frame as bytes."""
    return pack(["frame", number, [plain_event(event) for event in events], edit, digest])


def decode_frame(data: bytes, reader: Reader, seconds: float) -> Frame:
    """A frame from bytes. Raises ProtocolError and VocabularyError."""
    items = _items(data, "frame", 5)
    digest = items[4]
    if not isinstance(digest, bytes):
        raise ProtocolError("a digest is bytes")
    edit = as_list(items[3], "an edit")
    return Frame(_number(items), reader.events(items[2]), edit, digest, seconds)


def frame_number(data: bytes) -> int:
    """The number of a frame, or of the frame that a string begins. Raises ProtocolError."""
    return _number(as_list(unpack(data, LIMITS), "a message"))


def encode_string(number: int, scene: Scene) -> bytes:
    """A whole string as bytes."""
    return pack(["string", number, plain_scene(scene)])


def decode_string(data: bytes, reader: Reader) -> tuple[int, Scene]:
    """The frame that a string begins, and the string. Raises ProtocolError, VocabularyError."""
    items = _items(data, "string", 3)
    return _number(items), reader.scene(items[2])


def _items(data: bytes, name: str, count: int) -> list[Any]:
    items = as_list(unpack(data, LIMITS), f"a {name}")
    if len(items) != count or items[0] != name:
        raise ProtocolError(f"a {name} has {count} items and begins with its name")
    return items


def _number(items: list[Any]) -> int:
    return as_int(items[1] if len(items) > 1 else None, "the number of a frame")
