"""A file of Rerun, with pictures as its archetypes.

See https://rerun.io/docs/reference/types/archetypes.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import rerun as rr

from minerva_bus.errors import MisuseError
from minerva_bus.files import MARK, target_of
from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Copies, Discs, Picture, Polyline, Solid, Texts, Tiles
from minerva_services.views.solids import (
    DiscTable,
    Floor,
    disc_table,
    floor_meshes,
    image,
    named_floors,
    normals,
    segments,
    upright,
)

FRAME: Final = "frame"
TIME: Final = "time"
_END: Final = b"FOOT"
_END_BYTES: Final = 12
"""Mark in the last bytes of a complete file."""


def open_stream(world: str, path: Path, advice: str) -> rr.RecordingStream:
    """A new .rrd file with the timelines `frame` and `time`, to which entities are logged.

    Raises MisuseError, with the advice, if it cannot be written.
    """
    # The id is the part of the file's header by which a later run recognises the file. Its
    # random part keeps two recordings apart in a viewer.
    stream = rr.RecordingStream(
        world, recording_id=f"{MARK}, {secrets.token_hex(8)}", send_properties=False
    )
    path = target_of(path)
    try:
        if path.is_file():
            # The library writes into the file: through another name of the same file, it would
            # destroy that, such as the record that is being exported.
            path.unlink()
        stream.save(path)
    except Exception as error:  # the library raises RuntimeError
        raise MisuseError(f"rerun: cannot write {path}: {error}; {advice}") from None
    # The world has a time of its own; with the time of writing, no two files would be the same.
    stream.set_log_time_enabled(False)
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    return stream


def close_stream(stream: rr.RecordingStream, path: Path) -> None:
    """Finish an .rrd file. Raises MisuseError if it could not be written to its end."""
    problem = "its end could not be written"
    try:
        stream.flush()
    except Exception as error:  # the library raises RuntimeError
        problem = str(error)
    stream.disconnect()
    # If the end fails, the library only logs it.
    with contextlib.suppress(OSError), path.open("rb") as file:
        file.seek(-_END_BYTES, os.SEEK_END)
        if _END in file.read():
            return
    raise MisuseError(f"rerun: cannot write {path}: {problem}; is the disk full?")


class RrdFile:
    """Writes pictures to an .rrd file. Raises MisuseError if it cannot be written."""

    def __init__(self, world: str, path: Path) -> None:
        self._path = path
        self._stream = open_stream(world, path, "set path")
        self._floors: dict[str, tuple[Floor, frozenset[str]]] = {}
        self._shown: frozenset[str] = frozenset()
        self._solids: dict[str, Solid] = {}

    def show(self, picture: Picture, frame: int, time: float) -> None:
        """Write the picture of a frame at a world time in seconds."""
        self._stream.set_time(FRAME, sequence=frame)
        self._stream.set_time(TIME, duration=time)
        self._show_floors(named_floors(picture.of(Tiles)))
        shown = archetypes(picture)
        for path in ENTITIES:
            if path in shown:
                self._stream.log(path, shown[path])
            elif path in self._shown:
                self._clear(path)
        self._shown = frozenset(shown)
        self._show_solids(picture.of(Copies))

    def close(self) -> None:
        """Finish the file."""
        close_stream(self._stream, self._path)

    def _show_solids(self, groups: list[Copies]) -> None:
        shown = solid_archetypes(groups)
        for path in sorted(self._solids.keys() - shown.keys()):
            del self._solids[path]
            self._clear(path)
        for path, (solid, mesh, poses) in shown.items():
            # A mesh is written once, its copies move.
            if self._solids.get(path) is not solid:
                self._solids[path] = solid
                self._stream.log(path, mesh)
            self._stream.log(path, poses)

    def _show_floors(self, floors: dict[str, Floor]) -> None:
        for name in sorted(self._floors.keys() - floors.keys()):
            for path in sorted(self._floors.pop(name)[1]):
                self._clear(path)
        for name, floor in floors.items():
            before, paths = self._floors.get(name, (None, frozenset[str]()))
            if before is not None and before.is_same(floor):
                continue
            shown = floor_archetypes(f"world{name}", floor)
            for path in sorted(paths - shown.keys()):
                self._clear(path)
            for path, archetype in shown.items():
                self._stream.log(path, archetype)
            self._floors[name] = floor, frozenset(shown)

    def _clear(self, path: str) -> None:
        self._stream.log(path, rr.Clear(recursive=False))


Archetypes: TypeAlias = "dict[str, rr.AsComponents]"
"""Archetypes by the path of their entity."""

MOVERS: Final = "world/movers"
HEADINGS: Final = "world/headings"
LINES: Final = "world/lines"
LABELS: Final = "world/labels"
ENTITIES: Final = (MOVERS, HEADINGS, LINES, LABELS)
"""All entities except those of matrices."""

_TEXT_HEIGHT: Final = 0.1
_TEXT_PIXELS: Final = 4.0
_HEADING: Final = 0.8
"""Length of a heading's line in radii."""
_WHITE: Final = (255, 255, 255)


def archetypes(picture: Picture) -> Archetypes:
    """What a picture shows besides its matrices, by entity; no entity is empty."""
    discs = disc_table(picture.of(Discs))
    shown: Archetypes = {}
    if len(discs):
        shown[MOVERS] = _cylinders(discs)
    if discs.heading.any():
        shown[HEADINGS] = _headings(discs)
    lines: list[Polyline] = [line for line in picture.of(Polyline) if len(line.points) > 1]
    if lines:
        shown[LINES] = _lines(lines)
    texts: list[Texts] = picture.of(Texts)
    if texts:
        shown[LABELS] = _labels(texts, picture.marked())
    return shown


def solid_archetypes(
    groups: list[Copies],
) -> dict[str, tuple[Solid, rr.AsComponents, rr.AsComponents]]:
    """Solids with their mesh and the poses of their copies, by the path of their entity.

    A mesh has one colour, so each colour is an entity.
    """
    shown: dict[str, tuple[Solid, rr.AsComponents, rr.AsComponents]] = {}
    for number, copies in enumerate(groups):
        for red, green, blue in np.unique(copies.color, axis=0).tolist():
            rows = (copies.color == (red, green, blue)).all(axis=1)
            mesh = rr.Mesh3D(
                vertex_positions=copies.solid.vertices,
                triangle_indices=copies.solid.faces,
                vertex_normals=normals(copies.solid),
                albedo_factor=(red, green, blue),
            )
            poses = rr.InstancePoses3D(
                translations=copies.places[rows],
                quaternions=np.roll(copies.turns[rows], -1, axis=-1),  # x, y, z, w
                scales=copies.sizes[rows],
            )
            path = f"world/solids/{number}/{red:02x}{green:02x}{blue:02x}"
            shown[path] = copies.solid, mesh, poses
    return shown


def floor_archetypes(path: str, floor: Floor) -> Archetypes:
    """A matrix as walls and ground, or as an image on the ground."""
    tiles = floor.tiles
    turn = np.radians(tiles.pose.angle)
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    place = np.array([tiles.pose.x, tiles.pose.y, floor.height])
    if tiles.form.height:
        opaque = round(255 * min(max(tiles.form.opacity, 0.0), 1.0))
        return {
            f"{path}/{mesh.name}": rr.Mesh3D(
                vertex_positions=mesh.solid.vertices @ turned + place,
                triangle_indices=mesh.solid.faces,
                albedo_factor=[*mesh.color, opaque],
            )
            for mesh in floor_meshes(tiles)
        }
    width, depth = tiles.size
    corners = np.array([(0, 0, 0), (width, 0, 0), (width, depth, 0), (0, depth, 0)], np.float64)
    return {
        path: rr.Mesh3D(
            vertex_positions=corners @ turned + place,
            triangle_indices=[(0, 1, 2), (0, 2, 3)],
            vertex_texcoords=[(0, 0), (1, 0), (1, 1), (0, 1)],
            albedo_texture=image(tiles),
        )
    }


def _cylinders(discs: DiscTable) -> rr.Cylinders3D:
    return rr.Cylinders3D(
        lengths=discs.height,
        radii=discs.radius,
        centers=np.stack([discs.x, discs.y, discs.height / 2], axis=1),
        quaternions=np.roll(upright(discs.angle), -1, axis=-1),  # x, y, z, w
        colors=discs.color,
        fill_mode="solid",
        labels=[discs.agent(row) for row in range(len(discs))],
        show_labels=False,
    )


def _headings(discs: DiscTable) -> rr.LineStrips3D:
    marked = discs.heading
    turn, length = np.radians(discs.angle[marked]), _HEADING * discs.radius[marked]
    x, y, z = discs.x[marked], discs.y[marked], discs.mark_height[marked]
    ends = np.stack([x + length * np.cos(turn), y + length * np.sin(turn), z], axis=1)
    strips = np.stack([np.stack([x, y, z], axis=1), ends], axis=1).astype(np.float32)
    return rr.LineStrips3D(strips, radii=discs.radius[marked] / 10, colors=[_WHITE])


def _lines(lines: list[Polyline]) -> rr.LineStrips3D:
    pieces = [segments(line) for line in lines]
    counts = [len(piece) for piece in pieces]
    return rr.LineStrips3D(
        np.concatenate(pieces),
        radii=np.repeat([line.form.width / 2 for line in lines], counts),
        colors=np.repeat([rgb(line.form.color) for line in lines], counts, axis=0),
    )


def _labels(texts: list[Texts], marked: dict[str, str]) -> rr.Points3D:
    names = [text for batch in texts for text in batch.texts]
    x = np.concatenate([batch.x for batch in texts])
    y = np.concatenate([batch.y for batch in texts])
    return rr.Points3D(
        np.stack([x, y, np.full(len(x), _TEXT_HEIGHT)], axis=1),
        radii=rr.Radius.ui_points(_TEXT_PIXELS),
        colors=[rgb(marked.get(t, batch.form.color)) for batch in texts for t in batch.texts],
        labels=names,
        show_labels=True,
    )
