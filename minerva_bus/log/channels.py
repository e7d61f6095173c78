"""Channels of a record: our own in msgpack, and some in JSON, which other tools read, too.

Log lines and maps are Foxglove's JSON messages. Extensions add channels (`record_writer.py`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from minerva_bus.errors import MisuseError
from minerva_bus.wording import install

PROFILE: Final = "minerva"
"""Profile in the header of the MCAP file, which identifies our records."""

WORLD: Final = "minerva/world"
"""Description of the world, once with and once without the initial string."""

KEYFRAME: Final = "minerva/keyframe"
"""The complete state before a frame; written at frame 0 and at intervals."""

FRAME: Final = "minerva/frame"
"""Result of a frame: its events in order, the delta of the string, and the digest."""

CHECKPOINT: Final = "minerva/checkpoint"
"""Changes of the state beside the string, written before the frame that causes them."""

INPUTS: Final = "minerva/inputs"
"""Messages of members in a frame, except replies of hosts; written before the frame."""

SENSED: Final = "minerva/topic"
"""Messages on sensor topics, if recorded."""

TIMING: Final = "minerva/timing"
"""Duration of a frame."""

OPERATION: Final = "minerva/operation"
"""What people did to the running world, such as a pause."""

LOG: Final = "log"
MAP: Final = "map"

# New channels are appended: if all lists of channels in a file are damaged, a
# reader takes the ids from this order.
OWN: Final = (WORLD, KEYFRAME, FRAME, CHECKPOINT, SENSED, TIMING, LOG, MAP, INPUTS, OPERATION)
"""Channels of every record, with the ids 1, 2, ..."""

NANO: Final = 1_000_000_000
_LATEST: Final = (1 << 64) - 1

NUMBER: Final = {"type": "number"}
WHOLE: Final = {"type": "integer", "minimum": 0}
TEXT: Final = {"type": "string"}
BYTES: Final = {"type": "string", "contentEncoding": "base64"}


def schema_of(title: str = "", **properties: Any) -> dict[str, Any]:
    """The JSON schema of an object with these members."""
    return {"title": title, "type": "object", "properties": properties}


TIME: Final = schema_of("time", sec=WHOLE, nsec=WHOLE)
POINT: Final = schema_of("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
TURN: Final = schema_of("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE: Final = schema_of("foxglove.Pose", position=POINT, orientation=TURN)
_PACKED: Final = schema_of("foxglove.PackedElementField", name=TEXT, offset=WHOLE, type=WHOLE)


def stamped_schema(title: str, **properties: Any) -> dict[str, Any]:
    """The schema of a message of Foxglove about a frame of reference at a time."""
    return schema_of(title, timestamp=TIME, frame_id=TEXT, **properties)


SCHEMAS: Final[Mapping[str, dict[str, Any]]] = {
    TIMING: schema_of("minerva.Timing", frame=WHOLE, seconds=NUMBER),
    OPERATION: schema_of(
        "minerva.Operation", frame=WHOLE, command=TEXT, value=TEXT, person=TEXT
    ),
    LOG: schema_of(
        "foxglove.Log",
        timestamp=TIME, level=WHOLE, message=TEXT, name=TEXT, file=TEXT, line=WHOLE,
    ),
    # Declared here, because the ids of all our channels follow from their order.
    MAP: stamped_schema(
        "foxglove.Grid",
        pose=POSE,
        column_count=WHOLE,
        cell_size=schema_of("foxglove.Vector2", x=NUMBER, y=NUMBER),
        row_stride=WHOLE,
        cell_stride=WHOLE,
        fields={"type": "array", "items": _PACKED},
        data=BYTES,
    ),
}  # fmt: skip
"""Schemas of our channels in JSON."""


def time_of(frame: int, dt: float) -> int:
    """World time at which a frame begins, in nanoseconds; frame 0 begins at 0."""
    # Times of MCAP are unsigned 64-bit integers; a long step could exceed them.
    return min(round(frame * dt * NANO), _LATEST)


def check_installed() -> None:
    """Raise MisuseError if mcap is not installed."""
    try:
        import mcap.writer  # noqa: F401  # pyright: ignore[reportUnusedImport]
    except ImportError:
        raise MisuseError(f"records need mcap: {install('record')}") from None


_INFO, _WARNING = 2, 3


def encode_log(time: int, member: str, text: str, warning: bool) -> bytes:
    """A line of the log: `foxglove.Log`."""
    level = _WARNING if warning else _INFO
    plain = {"timestamp": time_stamp(time), "level": level, "message": text, "name": member}
    return plain_json(plain | {"file": "", "line": 0})


def time_stamp(nanoseconds: int) -> dict[str, int]:
    """A time in the form of Foxglove's messages."""
    return {"sec": nanoseconds // NANO, "nsec": nanoseconds % NANO}


def plain_json(plain: Mapping[str, Any]) -> bytes:
    """A message in JSON."""
    return json.dumps(plain, separators=(",", ":")).encode()
