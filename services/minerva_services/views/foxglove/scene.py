"""Pictures for Foxglove's 3D panel: an entity for each agent and one for the scenery, and grids.

Schemas: https://docs.foxglove.dev/docs/visualization/message-schemas/scene-entity
"""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import Final

import numpy as np
from foxglove import Context
from foxglove.channels import FrameTransformsChannel, GridChannel, SceneUpdateChannel
from foxglove.messages import (
    Color,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    Grid,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    PackedElementField,
    PackedElementFieldNumericType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector2,
    Vector3,
)
from foxglove.websocket import ChannelView, Client, ServerListener

from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Copies, Discs, Picture, Polyline, Solid, Texts, Tiles
from minerva_services.views.solids import (
    DiscTable,
    Floor,
    arrow,
    disc_table,
    floor_meshes,
    named_floors,
    pixels,
    segments,
    upright,
)

_NANO: Final = 1_000_000_000


class SubscriptionListener(ServerListener):
    """Sets an event at each new subscription; the server calls it in a thread of its own."""

    def __init__(self, subscribed: threading.Event) -> None:
        self._subscribed = subscribed

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._subscribed.set()


class SceneChannels:
    """Sends pictures on channels; matrices only when they change or after a new subscription."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._scene = SceneUpdateChannel("/scene", context=context)
        self._walls = SceneUpdateChannel("/walls", context=context)
        self._transforms = FrameTransformsChannel("/tf", context=context)
        self._grids: dict[str, GridChannel] = {}
        self._floors: dict[str, Floor] = {}
        self._entities: frozenset[str] = frozenset()

    def show(self, picture: Picture, time: int) -> None:
        """Send a picture of a world time in nanoseconds."""
        stamp = Timestamp(time // _NANO, time % _NANO)
        floors = named_floors(picture.of(Tiles))
        self._show_grids({n: f for n, f in floors.items() if not f.tiles.form.height}, stamp, time)
        self._show_walls({n: f for n, f in floors.items() if f.tiles.form.height}, stamp, time)
        self._floors = floors
        # Most worlds run without a subscriber most of the time.
        if self._scene.has_sinks():
            self._show_entities(picture, stamp, time)
        if self._transforms.has_sinks():
            placed = FrameTransforms(transforms=transforms(picture, stamp))
            self._transforms.log(placed, log_time=time)

    def forget(self) -> None:
        """Send all matrices with the next picture, for a new subscriber."""
        self._floors = {}

    def _show_entities(self, picture: Picture, stamp: Timestamp, time: int) -> None:
        entities = scene_entities(picture, stamp)
        gone = _deletions(self._entities - entities.keys(), stamp)
        self._entities = frozenset(entities)
        update = SceneUpdate(deletions=gone, entities=list(entities.values()))
        self._scene.log(update, log_time=time)

    def _show_walls(self, floors: dict[str, Floor], stamp: Timestamp, time: int) -> None:
        changed = [wall_entity(n, f.tiles, stamp) for n, f in floors.items() if self._differs(n, f)]
        before = {name for name, floor in self._floors.items() if floor.tiles.form.height}
        gone = _deletions(before - floors.keys(), stamp)
        if changed or gone:
            self._walls.log(SceneUpdate(deletions=gone, entities=changed), log_time=time)

    def _show_grids(self, floors: dict[str, Floor], stamp: Timestamp, time: int) -> None:
        for name in sorted(self._grids.keys() - floors.keys()):
            self._grids.pop(name).close()
        for name, floor in floors.items():
            if name not in self._grids:
                self._grids[name] = GridChannel(name, context=self._context)
            if self._differs(name, floor):
                self._grids[name].log(grid(floor, stamp), log_time=time)

    def _differs(self, name: str, floor: Floor) -> bool:
        before = self._floors.get(name)
        return before is None or not before.is_same(floor)


def _deletions(names: frozenset[str] | set[str], stamp: Timestamp) -> list[SceneEntityDeletion]:
    kind = SceneEntityDeletionType.MatchingId
    return [SceneEntityDeletion(timestamp=stamp, type=kind, id=name) for name in sorted(names)]


_FIELDS: Final = [
    PackedElementField(name=name, offset=place, type=PackedElementFieldNumericType.Uint8)
    for place, name in enumerate(("red", "green", "blue", "alpha"))
]


def grid(floor: Floor, stamp: Timestamp) -> Grid:
    """A matrix as an image on the ground; its rows extend along x, as a grid's columns do."""
    tiles = floor.tiles
    columns = tiles.cells.shape[0]
    w, x, y, z = upright(tiles.pose.angle).tolist()
    return Grid(
        timestamp=stamp,
        frame_id=GROUND,
        pose=Pose(
            position=Vector3(x=tiles.pose.x, y=tiles.pose.y, z=floor.height),
            orientation=Quaternion(x=x, y=y, z=z, w=w),
        ),
        column_count=columns,
        cell_size=Vector2(x=tiles.cell, y=tiles.cell),
        row_stride=4 * columns,
        cell_stride=4,
        fields=_FIELDS,
        data=pixels(tiles).tobytes(),
    )


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
    for copies in picture.of(Copies):
        for row, triangles in enumerate(_solids(copies)):
            parts[copies.owners[row]].triangles.append(triangles)
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
    solid = arrow()
    owners = chain.from_iterable(part.owners for part in discs.parts)
    # All rows at once: a cloud has thousands of points.
    columns = (
        discs.x, discs.y, upright(discs.angle), discs.radius, discs.height, discs.mark_height,
        discs.color, discs.heading,
    )  # fmt: skip
    rows = zip(owners, *[column.tolist() for column in columns], strict=True)
    for owner, x, y, (w, i, j, k), radius, height, top, color, heading in rows:
        turn = Quaternion(x=i, y=j, z=k, w=w)
        cylinder = CylinderPrimitive(
            pose=Pose(position=Vector3(x=x, y=y, z=height / 2), orientation=turn),
            size=Vector3(x=2 * radius, y=2 * radius, z=height),
            bottom_scale=1.0,
            top_scale=1.0,
            color=_color(color),
        )
        mark = None
        if heading:
            scaled = Solid(solid.vertices * np.float32(radius), solid.faces)
            pose = Pose(position=Vector3(x=x, y=y, z=top), orientation=turn)
            mark = _triangles(scaled, pose, _WHITE)
        yield owner, cylinder, mark


def _solids(copies: Copies) -> Iterator[TriangleListPrimitive]:
    """Each copy as triangles, whose format has poses and no scales."""
    turns = np.roll(copies.turns, -1, axis=-1).tolist()
    for row, (place, (x, y, z, w)) in enumerate(zip(copies.places.tolist(), turns, strict=True)):
        solid = Solid((copies.solid.vertices * copies.sizes[row]).astype("f4"), copies.solid.faces)
        pose = Pose(
            position=Vector3(x=place[0], y=place[1], z=place[2]),
            orientation=Quaternion(x=x, y=y, z=z, w=w),
        )
        yield _triangles(solid, pose, _color(copies.color[row].tolist()))


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
