"""Pictures as entities of Foxglove's 3D panel: one for each agent, and one for the scenery.

Schemas: https://docs.foxglove.dev/docs/visualization/message-schemas/scene-entity
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from foxglove.messages import (
    Color,
    CylinderPrimitive,
    FrameTransform,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)

from minerva_bus.semantics.colors import rgb
from minerva_bus.semantics.picture import Discs, Picture, Polyline, Texts, Tiles
from minerva_services.views.disc_table import DiscTable, disc_table
from minerva_services.views.floor_parts import floor_meshes
from minerva_services.views.line_segments import segments
from minerva_services.views.solids import Solid, arrow, upright

GROUND: Final = "world"
"""Name of the frame of reference."""
SCENERY: Final = "scenery"
"""Id of the entity of everything that belongs to no agent."""
_FONT_PIXELS: Final = 14.0
_TEXT_HEIGHT: Final = 0.1
"""Height of texts above the floor in metres."""
_WHITE: Final = Color(r=1.0, g=1.0, b=1.0, a=1.0)


@dataclass(slots=True)
class _EntityParts:
    """The primitives of an entity."""

    cylinders: list[CylinderPrimitive] = field(default_factory=list[CylinderPrimitive])
    triangles: list[TriangleListPrimitive] = field(default_factory=list[TriangleListPrimitive])
    lines: list[LinePrimitive] = field(default_factory=list[LinePrimitive])
    texts: list[TextPrimitive] = field(default_factory=list[TextPrimitive])


def scene_entities(picture: Picture, stamp: Timestamp) -> dict[str, SceneEntity]:
    """The entities of a picture by id, without its matrices."""
    parts: defaultdict[str, _EntityParts] = defaultdict(_EntityParts)
    for owner, cylinder, mark in _discs(disc_table(picture.of(Discs))):
        parts[owner].cylinders.append(cylinder)
        if mark is not None:
            parts[owner].triangles.append(mark)
    lines: list[Polyline] = picture.of(Polyline)
    for line in lines:
        parts[line.owner].lines.append(_line(line))
    marked = picture.marked()
    batches: list[Texts] = picture.of(Texts)
    for batch in batches:
        parts[batch.owner].texts += [
            _text(text, x, y, marked.get(text, batch.form.color))
            for text, x, y in zip(batch.texts, batch.x, batch.y, strict=True)
        ]
    return {owner or SCENERY: _entity(owner, parts[owner], stamp) for owner in sorted(parts)}


def wall_entity(name: str, tiles: Tiles, stamp: Timestamp) -> SceneEntity:
    """A floor with walls as an entity."""
    opacity = min(max(tiles.form.opacity, 0.0), 1.0)
    pose = _pose(tiles.pose.x, tiles.pose.y, 0.0, tiles.pose.angle)
    triangles = [
        _triangles(mesh.solid, pose, _color(mesh.color, opacity)) for mesh in floor_meshes(tiles)
    ]
    return SceneEntity(timestamp=stamp, frame_id=GROUND, id=name, triangles=triangles)


def transforms(picture: Picture, stamp: Timestamp) -> list[FrameTransform]:
    """The frames of reference of agents with a heading, each at its first disc."""
    discs, made = disc_table(picture.of(Discs)), dict[str, FrameTransform]()
    for row in np.flatnonzero(discs.heading).tolist():
        agent = discs.agent(row)
        if agent and agent not in made:
            made[agent] = FrameTransform(
                timestamp=stamp,
                parent_frame_id=GROUND,
                child_frame_id=agent,
                translation=Vector3(x=float(discs.x[row]), y=float(discs.y[row])),
                rotation=_rotation(float(discs.angle[row])),
            )
    return list(made.values())


def _discs(
    discs: DiscTable,
) -> Iterator[tuple[str, CylinderPrimitive, TriangleListPrimitive | None]]:
    """Owner, cylinder, and heading mark of each disc."""
    solid, tops = arrow(), discs.mark_height
    for row in range(len(discs)):
        x, y, angle = float(discs.x[row]), float(discs.y[row]), float(discs.angle[row])
        radius, height = float(discs.radius[row]), float(discs.height[row])
        cylinder = CylinderPrimitive(
            pose=_pose(x, y, height / 2, angle),
            size=Vector3(x=2 * radius, y=2 * radius, z=height),
            bottom_scale=1.0,
            top_scale=1.0,
            color=_color(discs.color[row].tolist()),
        )
        mark = None
        if discs.heading[row]:
            scaled = Solid(solid.vertices * np.float32(radius), solid.faces)
            mark = _triangles(scaled, _pose(x, y, float(tops[row]), angle), _WHITE)
        yield discs.owner(row), cylinder, mark


def _line(line: Polyline) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitiveLineType.LineList,
        pose=_pose(0.0, 0.0, 0.0, 0.0),
        thickness=line.form.width,
        points=_points(segments(line).reshape(-1, 3).tolist()),
        color=_color(rgb(line.form.color)),
    )


def _text(text: str, x: float, y: float, color: str) -> TextPrimitive:
    return TextPrimitive(
        pose=_pose(float(x), float(y), _TEXT_HEIGHT, 0.0),
        billboard=True,
        font_size=_FONT_PIXELS,
        scale_invariant=True,
        color=_color(rgb(color)),
        text=text,
    )


def _entity(owner: str, parts: _EntityParts, stamp: Timestamp) -> SceneEntity:
    return SceneEntity(
        timestamp=stamp,
        frame_id=GROUND,
        id=owner or SCENERY,
        metadata=[KeyValuePair(key="agent", value=owner)] if owner else [],
        cylinders=parts.cylinders,
        triangles=parts.triangles,
        lines=parts.lines,
        texts=parts.texts,
    )


def _triangles(solid: Solid, pose: Pose, color: Color) -> TriangleListPrimitive:
    return TriangleListPrimitive(
        pose=pose,
        points=_points(solid.vertices.tolist()),
        color=color,
        indices=solid.faces.ravel().tolist(),
    )


def _points(rows: list[list[float]]) -> list[Point3]:
    return [Point3(x=x, y=y, z=z) for x, y, z in rows]


def _pose(x: float, y: float, z: float, angle: float) -> Pose:
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=_rotation(angle))


def _rotation(angle: float) -> Quaternion:
    w, x, y, z = upright(angle).tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def _color(color: tuple[int, int, int] | list[int], opacity: float = 1.0) -> Color:
    red, green, blue = color
    return Color(r=red / 255, g=green / 255, b=blue / 255, a=opacity)
