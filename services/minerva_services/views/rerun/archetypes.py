"""Pictures as Rerun's archetypes: https://rerun.io/docs/reference/types/archetypes."""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
import rerun as rr

from minerva_bus.semantics.colors import rgb
from minerva_bus.semantics.picture import Discs, Picture, Polyline, Texts
from minerva_services.views.disc_table import DiscTable, disc_table
from minerva_services.views.floor_parts import Floor, floor_meshes, image
from minerva_services.views.line_segments import segments
from minerva_services.views.solids import upright

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
