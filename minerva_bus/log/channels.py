"""Channels of a record: our own in msgpack, and those for other tools in JSON."""

from __future__ import annotations

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
POSES: Final = "poses/"
"""Prefix before the symbol of an agent kind."""

TOPICS: Final = "topics/"
"""Prefix before the name of a sensor topic and its publisher."""

TRANSFORMS: Final = "transforms"
"""Poses of the robots whose sensor data are shown."""

# New channels are appended: if all lists of channels in a file are damaged, a
# reader takes the ids from this order.
OWN: Final = (WORLD, KEYFRAME, FRAME, CHECKPOINT, SENSED, TIMING, LOG, MAP, INPUTS, OPERATION)
"""Channels of every record, with the ids 1, 2, ..."""

NANO: Final = 1_000_000_000
_LATEST: Final = (1 << 64) - 1

_NUMBER: Final = {"type": "number"}
_WHOLE: Final = {"type": "integer", "minimum": 0}
_TEXT: Final = {"type": "string"}


def _object(title: str = "", **properties: Any) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


def _stamped(title: str, **properties: Any) -> dict[str, Any]:
    """A message of Foxglove about a frame of reference at a time."""
    return _object(title, timestamp=_TIME, frame_id=_TEXT, **properties)


_TIME: Final = _object("time", sec=_WHOLE, nsec=_WHOLE)
_POINT: Final = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_TURN: Final = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE: Final = _object("foxglove.Pose", position=_POINT, orientation=_TURN)
_NUMBERS: Final = {"type": "array", "items": _NUMBER}
_BYTES: Final = {"type": "string", "contentEncoding": "base64"}
_PACKED: Final = _object("foxglove.PackedElementField", name=_TEXT, offset=_WHOLE, type=_WHOLE)

SCHEMAS: Final[dict[str, dict[str, Any]]] = {
    schema["title"]: schema
    for schema in (
        _object("minerva.Timing", frame=_WHOLE, seconds=_NUMBER),
        _object(
            "minerva.Operation", frame=_WHOLE, command=_TEXT, value=_TEXT, person=_TEXT
        ),
        _object(
            "foxglove.Log",
            timestamp=_TIME, level=_WHOLE, message=_TEXT, name=_TEXT, file=_TEXT, line=_WHOLE,
        ),
        _stamped("foxglove.PosesInFrame", poses={"type": "array", "items": _POSE}),
        _stamped(
            "foxglove.Grid",
            pose=_POSE,
            column_count=_WHOLE,
            cell_size=_object("foxglove.Vector2", x=_NUMBER, y=_NUMBER),
            row_stride=_WHOLE,
            cell_stride=_WHOLE,
            fields={"type": "array", "items": _PACKED},
            data=_BYTES,
        ),
        _stamped(
            "foxglove.LaserScan",
            pose=_POSE, start_angle=_NUMBER, end_angle=_NUMBER, ranges=_NUMBERS,
            intensities=_NUMBERS,
        ),
        _stamped("foxglove.CompressedImage", data=_BYTES, format=_TEXT),
        _stamped(
            "foxglove.RawImage",
            width=_WHOLE, height=_WHOLE, encoding=_TEXT, step=_WHOLE, data=_BYTES,
        ),
        _stamped("foxglove.PoseInFrame", pose=_POSE),
        _stamped(
            "foxglove.LocationFix",
            latitude=_NUMBER, longitude=_NUMBER, altitude=_NUMBER, position_covariance=_NUMBERS,
            position_covariance_type=_WHOLE,
        ),
        _object(
            "foxglove.FrameTransform",
            timestamp=_TIME, parent_frame_id=_TEXT, child_frame_id=_TEXT, translation=_POINT,
            rotation=_TURN,
        ),
    )
}  # fmt: skip
"""JSON schemas by their names in Foxglove and Lichtblick."""

SCHEMA_OF: Final = {
    TIMING: "minerva.Timing",
    OPERATION: "minerva.Operation",
    LOG: "foxglove.Log",
    MAP: "foxglove.Grid",
}
"""Schema of each channel of our own in JSON."""


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
