"""Channels of a record: our own in msgpack, and those for other tools in JSON.

Poses, maps, log lines and sensor data are Foxglove's JSON messages. Positions of agents are derived
from the names of their attributes:

    x, y                        metres
    row, column, cell, x0, y0   cells: x = x0 + row · cell, y = y0 + column · cell (cell defaults
                                to 1, x0 and y0 to 0)

The heading is `angle` or `heading` in degrees, or the direction of `vx` and `vy`. Kinds without
such attributes have no position. Transformations around an agent move it by their motions.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.appearance import Motion, Raster, Shape
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import (
    EMPTY,
    AgentNode,
    FigureNode,
    Piece,
    Scene,
    TransformationNode,
    fill_slots,
    walk,
)
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry, after, raster_corner, resolve
from minerva_bus.semantics.poses import Pose
from minerva_bus.wording import install
from minerva_bus.world.readings import Image, Mount, Odometry, Position, Reading, Scan

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


# --- where the agents of a string are ---

Numbers = NDArray[np.float64]
_Get = Callable[[str, float], Numbers]

_NUMERIC: Final = frozenset(("real", "int"))
_ORIGIN: Final = Pose()
_PLANE: Final = frozenset(("x", "y"))
_GRID: Final = frozenset(("row", "column"))


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Positions of agents of one kind: n ids, x and y in metres, angle in degrees, each (n,)."""

    kind: str
    ids: Sequence[str]
    x: Numbers
    y: Numbers
    angle: Numbers

    def of(self, wanted: Container[str]) -> Iterator[tuple[str, float, float, float]]:
        """Id, x, y and angle of the agents with these ids."""
        rows = zip(self.ids, self.x.tolist(), self.y.tolist(), self.angle.tolist(), strict=True)
        return (row for row in rows if row[0] in wanted)


def placed_kinds(vocabulary: Vocabulary) -> dict[str, frozenset[str]]:
    """Kinds whose agents have positions, with their numeric attributes."""
    numbers = {
        kind.name: frozenset([f.name for f in kind.fields.all if f.type.kind in _NUMERIC])
        for kind in vocabulary.kinds.values()
    }
    return {kind: names for kind, names in numbers.items() if names >= _PLANE or names >= _GRID}


class Surveyor:
    """Finds the positions of agents, about `most` of each kind (0: all).

    Of a population in columns every n-th agent is taken, so the selection is stable over time.
    """

    def __init__(self, vocabulary: Vocabulary, most: int = 0) -> None:
        self.placed = placed_kinds(vocabulary)
        self._vocabulary = vocabulary
        self._most = most

    def places(self, scene: Scene) -> dict[str, Positions]:
        """Positions of agents by kind."""
        parts: dict[str, list[Positions]] = {}
        for part in self._all_places(scene):
            parts.setdefault(part.kind, []).append(part)
        return {kind: _together(kind, of_kind) for kind, of_kind in sorted(parts.items())}

    def _all_places(self, scene: Scene) -> Iterator[Positions]:
        nodes: list[Piece] = []
        for piece in scene.pieces:
            if piece.ids is not None:
                if piece.symbol in self.placed:
                    # The nodes before the columns are first, so that agents
                    # stay in the order of the string.
                    yield from _of_nodes(nodes, self._vocabulary, self.placed)
                    yield _of_columns(piece, self.placed[piece.symbol], self._most)
                    nodes = []
            elif not piece.still:
                nodes.append(piece)
        yield from _of_nodes(nodes, self._vocabulary, self.placed)


def _of_columns(piece: Columns, names: frozenset[str], most: int) -> Positions:
    # Rounded up, so that at most this many are taken.
    step = -(-piece.count // most) if most else 1
    sample = piece.take(slice(0, None, step)) if step > 1 else piece

    def get(name: str, default: float) -> Numbers:
        known = name in names
        return sample.column(name).astype(np.float64) if known else np.full(sample.count, default)

    x, y, angle = _place(names, get)
    ids = sample.ids.texts() if sample.ids is not None else []
    return Positions(sample.symbol, ids, x, y, angle)


def _of_nodes(
    pieces: Sequence[Piece], vocabulary: Vocabulary, placed: Mapping[str, frozenset[str]]
) -> Iterator[Positions]:
    """Positions of agents in these pieces, moved by the transformations around them."""
    posed: dict[str, list[tuple[AgentNode, Pose]]] = {}
    for piece in pieces:
        if isinstance(piece, AgentNode) and not piece.scope.pieces:  # The usual case.
            if piece.symbol in placed:
                posed.setdefault(piece.symbol, []).append((piece, _ORIGIN))
        else:
            _find(piece, vocabulary, placed, posed)
    for kind, agents in posed.items():
        yield _of_agents(kind, agents, placed[kind])


def _find(
    piece: Piece,
    vocabulary: Vocabulary,
    placed: Container[str],
    posed: dict[str, list[tuple[AgentNode, Pose]]],
) -> None:
    """Collect the agents within a piece, or the piece itself, with their poses."""
    poses = [_ORIGIN]
    for opens, node in walk(Scene((piece,))):
        if isinstance(node, FigureNode):
            continue
        if isinstance(node, TransformationNode):
            if opens:
                declared = vocabulary.transformations.get(node.symbol)
                motion = (declared.motion if declared is not None else None) or Motion()
                poses.append(after(motion, node.parameters, poses[-1]))
            else:
                poses.pop()
        elif opens and node.symbol in placed:
            posed.setdefault(node.symbol, []).append((node, poses[-1]))


def _of_agents(
    kind: str, posed: Sequence[tuple[AgentNode, Pose]], names: frozenset[str]
) -> Positions:
    nodes = [node for node, _ in posed]

    def get(name: str, default: float) -> Numbers:
        if name not in names:
            return np.full(len(nodes), default)
        usual = nodes[0].names
        at = usual.index(name)
        # Agents of one kind share the tuple of names, so its index is looked up once.
        values = [
            node.values[at if node.names is usual else node.names.index(name)] for node in nodes
        ]
        return np.array(values, np.float64)

    x, y, angle = _place(names, get)
    ids = [node.id for node in nodes]
    # Most agents are not inside of transformations.
    if all(pose is _ORIGIN for _, pose in posed):
        return Positions(kind, ids, x, y, angle)
    at = np.array([(pose.x, pose.y, pose.angle) for _, pose in posed])
    turned = np.radians(at[:, 2])
    # numpy's functions suffice here: these positions are only displayed and never enter the string.
    cos, sin = np.cos(turned), np.sin(turned)
    return Positions(
        kind, ids, at[:, 0] + x * cos - y * sin, at[:, 1] + x * sin + y * cos, at[:, 2] + angle
    )


def _place(names: frozenset[str], get: _Get) -> tuple[Numbers, Numbers, Numbers]:
    """x, y and angle of agents."""
    if names >= _PLANE:
        x, y = get("x", 0.0), get("y", 0.0)
    else:
        cell = get("cell", 1.0)
        x = get("x0", 0.0) + get("row", 0.0) * cell
        y = get("y0", 0.0) + get("column", 0.0) * cell
    if names >= {"vx", "vy"} and names.isdisjoint(("angle", "heading")):
        return x, y, np.degrees(np.arctan2(get("vy", 0.0), get("vx", 0.0)))
    return x, y, get("angle" if "angle" in names else "heading", 0.0)


def _together(kind: str, parts: Sequence[Positions]) -> Positions:
    if len(parts) == 1:
        return parts[0]
    return Positions(
        kind,
        [name for part in parts for name in part.ids],
        np.concatenate([part.x for part in parts]),
        np.concatenate([part.y for part in parts]),
        np.concatenate([part.angle for part in parts]),
    )


# --- poses, maps and log lines ---

GROUND: Final = "world"
"""Name of the frame of reference."""

_POSES_TEXT: Final = '{"timestamp":{"sec":%d,"nsec":%d},"frame_id":"%s","poses":[%s]}'
_POSE_TEXT: Final = (
    '{"position":{"x":%.4f,"y":%.4f,"z":0},"orientation":{"x":0,"y":0,"z":%.6f,"w":%.6f}}'
)
"""A template instead of `json.dumps`, because a population has very many poses."""

_UINT8: Final = 1
_INFO, _WARNING = 2, 3
_FIELDS: Final = [
    {"name": name, "offset": place, "type": _UINT8}
    for place, name in enumerate(("red", "green", "blue", "alpha"))
]


def encode_log(time: int, member: str, text: str, warning: bool) -> bytes:
    """A line of the log: `foxglove.Log`."""
    level = _WARNING if warning else _INFO
    plain = {"timestamp": time_stamp(time), "level": level, "message": text, "name": member}
    return _json(plain | {"file": "", "line": 0})


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
    return (_json(grid) for grid in maps.grids)


def without_agents(scene: Scene) -> Scene:
    """A string without its agents."""
    made: list[Piece] = []
    for piece in scene.pieces:
        if piece.still:
            made.append(piece)
        elif piece.ids is None:
            made += fill_slots(Scene((piece,)), lambda _: EMPTY).pieces
    return Scene(tuple(made))


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


def painted(raster: Raster, cells: Any) -> Any:
    """The colours of a raster's cells, (rows, columns, 4), red to alpha from 0 to 255."""
    painted = np.zeros((*cells.shape, 4), np.uint8)
    for least, color in raster.colors:
        painted[cells >= least] = _rgba(color, raster.opacity)
    return painted


def _rgba(color: str, opacity: float) -> tuple[int, int, int, int]:
    if not color:
        return 0, 0, 0, 0
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue, round(255 * opacity)


def time_stamp(nanoseconds: int) -> dict[str, int]:
    """A time in the form of Foxglove's messages."""
    return {"sec": nanoseconds // NANO, "nsec": nanoseconds % NANO}


def pose_of(x: float, y: float, angle: float) -> dict[str, dict[str, float]]:
    """A pose in the plane (metres, degrees) in the form of Foxglove's messages."""
    half = math.radians(angle) / 2
    return _pose(x, y, math.sin(half), math.cos(half))


def _pose(x: float, y: float, sine: float, cosine: float) -> dict[str, dict[str, float]]:
    """`sine` and `cosine` are of half the angle about the z axis."""
    return {
        "position": {"x": x, "y": y, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": sine, "w": cosine},
    }


def _json(plain: dict[str, Any]) -> bytes:
    return json.dumps(plain, separators=(",", ":")).encode()


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
    return _json(plain)


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


_STEPS: Final = {"rgb8": 3, "mono8": 1}


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
