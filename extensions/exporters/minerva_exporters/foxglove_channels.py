"""Channels of a record for other tools: poses, maps and sensor data as Foxglove's JSON messages.

Readers of records ignore them; everything in them follows from the other channels.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from minerva_analysis.places import SHOWN, Positions, Surveyor, painted, without_agents
from minerva_bus.frame.messages import Readings
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.appearance import Raster, Shape
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.channels import (
    BYTES,
    MAP,
    NANO,
    NUMBER,
    POINT,
    POSE,
    TEXT,
    TIME,
    TURN,
    WHOLE,
    plain_json,
    schema_of,
    stamped_schema,
    time_of,
    time_stamp,
)
from minerva_bus.log.record_writer import FurtherChannels, McapFile
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry, raster_corner, resolve
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Image, Mount, Odometry, Position, Reading, Scan

POSES: Final = "poses/"
"""Prefix before the symbol of an agent kind."""

TOPICS: Final = "topics/"
"""Prefix before the name of a sensor topic and its publisher."""

TRANSFORMS: Final = "transforms"
"""Poses of the robots whose sensor data are shown."""

_NUMBERS: Final = {"type": "array", "items": NUMBER}

SCHEMAS: Final[Mapping[str, dict[str, Any]]] = {
    schema["title"]: schema
    for schema in (
        stamped_schema("foxglove.PosesInFrame", poses={"type": "array", "items": POSE}),
        stamped_schema(
            "foxglove.LaserScan",
            pose=POSE, start_angle=NUMBER, end_angle=NUMBER, ranges=_NUMBERS, intensities=_NUMBERS,
        ),
        stamped_schema("foxglove.CompressedImage", data=BYTES, format=TEXT),
        stamped_schema(
            "foxglove.RawImage", width=WHOLE, height=WHOLE, encoding=TEXT, step=WHOLE, data=BYTES
        ),
        stamped_schema("foxglove.PoseInFrame", pose=POSE),
        stamped_schema(
            "foxglove.LocationFix",
            latitude=NUMBER, longitude=NUMBER, altitude=NUMBER, position_covariance=_NUMBERS,
            position_covariance_type=WHOLE,
        ),
        schema_of(
            "foxglove.FrameTransform",
            timestamp=TIME, parent_frame_id=TEXT, child_frame_id=TEXT, translation=POINT,
            rotation=TURN,
        ),
    )
}  # fmt: skip
"""JSON schemas by their names in Foxglove and Lichtblick."""


# --- poses and maps ---

GROUND: Final = "world"
"""Name of the frame of reference."""

_POSES_TEXT: Final = '{"timestamp":{"sec":%d,"nsec":%d},"frame_id":"%s","poses":[%s]}'
_POSE_TEXT: Final = (
    '{"position":{"x":%.4f,"y":%.4f,"z":0},"orientation":{"x":0,"y":0,"z":%.6f,"w":%.6f}}'
)
"""A template instead of `json.dumps`, because a population has very many poses."""

_UINT8: Final = 1
_FIELDS: Final = [
    {"name": name, "offset": place, "type": _UINT8}
    for place, name in enumerate(("red", "green", "blue", "alpha"))
]


def encode_poses(time: int, places: Positions) -> bytes:
    """Poses of the agents of a kind: `foxglove.PosesInFrame`."""
    # A rotation about z by an angle is the quaternion (0, 0, sin, cos) of half the angle.
    half = np.radians(places.angle) / 2
    rows = np.column_stack((places.x, places.y, np.sin(half), np.cos(half))).tolist()
    poses = ",".join([_POSE_TEXT % tuple(row) for row in rows])
    return (_POSES_TEXT % (time // NANO, time % NANO, GROUND, poses)).encode()


def encode_maps(scene: Scene, vocabulary: Vocabulary) -> Iterator[bytes]:
    """The rasters of a string outside of all agents: `foxglove.Grid`."""
    maps = _Maps(vocabulary)
    interpret(without_agents(scene), maps)
    return (plain_json(grid) for grid in maps.grids)


class _Maps(PlaneGeometry):
    """A geometry that interprets rasters as grids and ignores everything else."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.grids: list[dict[str, Any]] = []

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        if isinstance(shape, Raster):
            self.grids.append(_grid(shape, figure, self.pose))


def _grid(raster: Raster, figure: FigureNode, at: Pose) -> dict[str, Any]:
    parameters = figure.parameters
    corner = raster_corner(raster, figure.parameters, at)
    cell, cells = resolve(raster.cell, parameters), parameters[raster.cells]
    return {
        "timestamp": time_stamp(0),
        "frame_id": GROUND,
        "pose": pose_of(corner.x, corner.y, corner.angle),
        "column_count": cells.shape[0],
        "cell_size": {"x": cell, "y": cell},
        "row_stride": 4 * cells.shape[0],
        "cell_stride": 4,
        "fields": _FIELDS,
        # The rows of a raster run along x, those of a Grid along y.
        "data": base64.b64encode(painted(raster, cells).swapaxes(0, 1).tobytes()).decode(),
    }


def pose_of(x: float, y: float, angle: float) -> dict[str, dict[str, float]]:
    """A pose in the plane (metres, degrees) in the form of Foxglove's messages."""
    half = math.radians(angle) / 2
    return {
        "position": {"x": x, "y": y, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)},
    }


# --- sensor data ---


def shown_readings(message: Readings, time: int) -> Iterator[tuple[str, bytes]]:
    """Schema and JSON message of each reading of a kind that has a schema."""
    for reading in message.readings:
        shown = _shown(reading, time)
        if shown is not None:
            schema, plain = shown
            # `allow_nan=False`, because NaN and Infinity are not JSON, and
            # other tools would reject the file.
            yield schema, json.dumps(plain, separators=(",", ":"), allow_nan=False).encode()


def encode_transform(robot: str, time: int, x: float, y: float, angle: float) -> bytes:
    """Pose of a robot at which its sensor data are shown, in metres and degrees."""
    pose = pose_of(x, y, angle)
    plain = {
        "timestamp": time_stamp(time),
        "parent_frame_id": GROUND,
        "child_frame_id": robot,
        "translation": pose["position"],
        "rotation": pose["orientation"],
    }
    return plain_json(plain)


def _shown(reading: Reading, time: int) -> tuple[str, dict[str, Any]] | None:
    about: dict[str, Any] = {"timestamp": time_stamp(time), "frame_id": reading.robot or GROUND}
    if isinstance(reading, Scan):
        return "foxglove.LaserScan", about | _scan(reading)
    if isinstance(reading, Image):
        return _image(reading, about)
    if isinstance(reading, Odometry):
        about["frame_id"] = f"{reading.robot}/odometry"
        about["pose"] = pose_of(reading.x, reading.y, reading.angle)
        return "foxglove.PoseInFrame", about
    if isinstance(reading, Position):
        return "foxglove.LocationFix", about | _location(reading)
    return None


_UNKNOWN, _APPROXIMATED = 0, 1
"""Types of covariance in foxglove.LocationFix."""


def _location(position: Position) -> dict[str, Any]:
    """A position; an unknown altitude is 0, because the schema requires a number."""
    return {
        "latitude": position.latitude,
        "longitude": position.longitude,
        "altitude": position.altitude or 0.0,
        "position_covariance": _covariance(position.accuracy or 0.0),
        "position_covariance_type": _UNKNOWN if position.accuracy is None else _APPROXIMATED,
    }


def _covariance(accuracy: float) -> Sequence[float]:
    variance = accuracy * accuracy
    return [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance]


def _scan(scan: Scan) -> dict[str, Any]:
    last = scan.first + scan.step * (len(scan.ranges) - 1)
    ranges: list[float] = scan.ranges.astype("f8").tolist()
    return {
        "pose": _mounted(Mount(scan.mount_x, scan.mount_y, scan.mount_angle)),
        "start_angle": math.radians(scan.first),
        "end_angle": math.radians(last),
        # JSON has no infinity; 0 also means no hit.
        "ranges": [value if math.isfinite(value) else 0.0 for value in ranges],
        "intensities": [],
    }


def _mounted(mount: Mount) -> Mapping[str, Any]:
    return pose_of(mount.x, mount.y, mount.angle)


_STEPS: Final = {"rgb8": 3, "mono8": 1, "32FC1": 4}


def _image(image: Image, about: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    about["data"] = base64.b64encode(image.data).decode()
    step = _STEPS.get(image.encoding)
    if step is None:
        return "foxglove.CompressedImage", about | {"format": image.encoding}
    return "foxglove.RawImage", about | {
        "width": image.width,
        "height": image.height,
        "encoding": image.encoding,
        "step": step * image.width,
    }


# --- writing them ---

SHOWN_EVERY: Final = 0.1
"""Seconds of world time between two shown poses of an agent."""


class FoxgloveChannels(FurtherChannels):
    """Writes these channels of one record."""

    def __init__(self, file: McapFile, world: WorldSpec) -> None:
        self._file = file
        self._world = world
        self._surveyor = Surveyor(world.vocabulary, SHOWN)
        self._last_shown = -SHOWN_EVERY
        self._robots: set[str] = set()
        for kind in self._surveyor.placed:
            file.register(POSES + kind, SCHEMAS["foxglove.PosesInFrame"])

    def begin(self) -> None:
        """Write the rasters of the initial string."""
        # The parts outside of all agents never change, so their maps are written once.
        for grid in encode_maps(self._world.scene, self._world.vocabulary):
            self._file.put(MAP, grid, 0, 0.0)

    def string(self, scene: Scene, frame: int, seconds: float) -> None:
        """Write the poses before a frame, if they are due: of agents, and of robots that sense."""
        now, time = frame * self._world.dt, time_of(frame, self._world.dt)
        if now - self._last_shown < SHOWN_EVERY:
            return
        self._last_shown = now
        for kind, places in self._surveyor.places(scene).items():
            self._file.put(POSES + kind, encode_poses(time, places), frame, seconds)
            for robot, x, y, angle in places.of(self._robots) if self._robots else ():
                self._file.register(TRANSFORMS, SCHEMAS["foxglove.FrameTransform"])
                data = encode_transform(robot, time, x, y, angle)
                self._file.put(TRANSFORMS, data, frame, seconds)

    def readings(self, message: Readings, frame: int, seconds: float) -> None:
        """Write readings that arrived during a frame."""
        for schema, data in shown_readings(message, time_of(frame, self._world.dt)):
            topic = f"{TOPICS}{message.topic}/{message.member}/{schema.partition('.')[2]}"
            self._file.register(topic, SCHEMAS[schema])
            self._file.put(topic, data, frame, seconds, frame)
        # Only robots that sense need transforms: other tools place sensor data by them.
        self._robots.update(reading.robot for reading in message.readings)
