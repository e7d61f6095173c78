"""The channels of a record: our own, in msgpack, and those that other tools show, in JSON."""

from __future__ import annotations

from typing import Any, Final

PROFILE: Final = "minerva"
"""The profile in the header of the MCAP file, by which a record of ours is known."""

WORLD: Final = "minerva/world"
"""One message: the description of the world."""

STRING: Final = "minerva/string"
"""Now and then, the first time at frame 0: the whole string with which a frame begins."""

FRAME: Final = "minerva/frame"
"""What happened in a frame: its events in order, and what has changed in the string."""

CHECKPOINT: Final = "minerva/checkpoint"
"""Before a frame: what is needed beside the string after it to go on from there."""

SENSED: Final = "minerva/topic"
"""What came on sensor topics, where that is recorded."""

TIMING: Final = "minerva/timing"
"""How long a frame took."""

LOG: Final = "log"
MAP: Final = "map"
POSES: Final = "poses/"
"""Before the symbol of an agent kind."""

TOPICS: Final = "topics/"
"""Before the name of a sensor topic and that of who publishes there."""

TRANSFORMS: Final = "transforms"
"""Where those are whose sensors are shown."""

OWN: Final = (WORLD, STRING, FRAME, CHECKPOINT, SENSED, TIMING, LOG, MAP)
"""The channels that each record has; their ids are 1, 2, ..."""

NANO: Final = 1_000_000_000
_LATEST: Final = (1 << 64) - 1

_NUMBER: Final = {"type": "number"}
_WHOLE: Final = {"type": "integer", "minimum": 0}
_TEXT: Final = {"type": "string"}


def _object(title: str = "", **properties: Any) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties}


_TIME: Final = _object("time", sec=_WHOLE, nsec=_WHOLE)
_POINT: Final = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_TURN: Final = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE: Final = _object(
    "foxglove.Pose",
    position=_POINT,
    orientation=_TURN,
)
_NUMBERS: Final = {"type": "array", "items": _NUMBER}
_BYTES: Final = {"type": "string", "contentEncoding": "base64"}
_PACKED: Final = _object("foxglove.PackedElementField", name=_TEXT, offset=_WHOLE, type=_WHOLE)

SCHEMAS: Final[dict[str, dict[str, Any]]] = {
    "minerva.Timing": _object("minerva.Timing", frame=_WHOLE, seconds=_NUMBER),
    "foxglove.Log": _object(
        "foxglove.Log",
        timestamp=_TIME,
        level=_WHOLE,
        message=_TEXT,
        name=_TEXT,
        file=_TEXT,
        line=_WHOLE,
    ),
    "foxglove.PosesInFrame": _object(
        "foxglove.PosesInFrame",
        timestamp=_TIME,
        frame_id=_TEXT,
        poses={"type": "array", "items": _POSE},
    ),
    "foxglove.Grid": _object(
        "foxglove.Grid",
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_POSE,
        column_count=_WHOLE,
        cell_size=_object("foxglove.Vector2", x=_NUMBER, y=_NUMBER),
        row_stride=_WHOLE,
        cell_stride=_WHOLE,
        fields={"type": "array", "items": _PACKED},
        data=_BYTES,
    ),
    "foxglove.LaserScan": _object(
        "foxglove.LaserScan",
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_POSE,
        start_angle=_NUMBER,
        end_angle=_NUMBER,
        ranges=_NUMBERS,
        intensities=_NUMBERS,
    ),
    "foxglove.CompressedImage": _object(
        "foxglove.CompressedImage", timestamp=_TIME, frame_id=_TEXT, data=_BYTES, format=_TEXT
    ),
    "foxglove.RawImage": _object(
        "foxglove.RawImage",
        timestamp=_TIME,
        frame_id=_TEXT,
        width=_WHOLE,
        height=_WHOLE,
        encoding=_TEXT,
        step=_WHOLE,
        data=_BYTES,
    ),
    "foxglove.PoseInFrame": _object(
        "foxglove.PoseInFrame", timestamp=_TIME, frame_id=_TEXT, pose=_POSE
    ),
    "foxglove.LocationFix": _object(
        "foxglove.LocationFix",
        timestamp=_TIME,
        frame_id=_TEXT,
        latitude=_NUMBER,
        longitude=_NUMBER,
        altitude=_NUMBER,
        position_covariance=_NUMBERS,
        position_covariance_type=_WHOLE,
    ),
    "foxglove.FrameTransform": _object(
        "foxglove.FrameTransform",
        timestamp=_TIME,
        parent_frame_id=_TEXT,
        child_frame_id=_TEXT,
        translation=_POINT,
        rotation=_TURN,
    ),
}
"""JSON schemas of the messages in JSON, by the names that Foxglove and Lichtblick know."""

SCHEMA_OF: Final = {TIMING: "minerva.Timing", LOG: "foxglove.Log", MAP: "foxglove.Grid"}
"""Which of them each channel has; those of poses have `foxglove.PosesInFrame`."""


def time_of(frame: int, dt: float) -> int:
    """When a frame begins, in nanoseconds of the world's own time; frame 0 begins at 0."""
    return min(round(frame * dt * NANO), _LATEST)
