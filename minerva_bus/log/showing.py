"""Poses, map and log of a record as Foxglove's JSON messages, for other tools."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from minerva_bus.grammar.appearance import Raster, Shape
from minerva_bus.grammar.scene import EMPTY, FigureNode, Piece, Scene
from minerva_bus.grammar.traversal import fill_slots
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.channels import NANO
from minerva_bus.log.places import Positions
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import PlaneGeometry, raster_corner, resolve
from minerva_bus.semantics.poses import Pose

GROUND: Final = "world"
"""Name of the frame of reference."""

_POSES: Final = '{"timestamp":{"sec":%d,"nsec":%d},"frame_id":"%s","poses":[%s]}'
_POSE: Final = (
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
    poses = ",".join([_POSE % tuple(row) for row in rows])
    return (_POSES % (time // NANO, time % NANO, GROUND, poses)).encode()


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
