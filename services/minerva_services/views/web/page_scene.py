"""The scene of the page: discs, lines, floors, images and labels of a picture, as nodes of viser.

Copies of a solid are one node, however many there are. Labels keep their size on the screen.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from viser import (
    BatchedMeshHandle,
    ImageHandle,
    LabelHandle,
    LineSegmentsHandle,
    MeshHandle,
    SceneApi,
    ViserServer,
)

from minerva_bus.semantics.plane import Bounds
from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import (
    Copies,
    Discs,
    Picture,
    Polyline,
    Solid,
    Texts,
    Tiles,
)
from minerva_services.views.names import AgentName, agent_names
from minerva_services.views.solids import (
    DiscTable,
    Floor,
    arrow,
    cylinder,
    disc_table,
    floor_meshes,
    image,
    named_floors,
    pin,
    ring,
    segments,
    upright,
)
from minerva_services.views.web.camera_control import CameraControl, bounds_of
from minerva_services.views.web.picking import Clicked, clicked

Point: TypeAlias = tuple[float, float, float]

_NAME_HEIGHT = 0.3
"""Distance of an agent's name from its disc, in heights of a pin."""
_ACCENT = (255, 196, 0)
_RING_LEVEL = 0.05
"""Height in metres of the ring around a selected agent, above its lowest point."""


@dataclass(frozen=True, slots=True)
class _Mark:
    """An agent's fragment, and the middle and radius of its ring, and its highest point; metres."""

    owner: str
    low: Point
    radius: float
    top: float


class PageScene:
    """Draws pictures; sends changes and removes what is gone. Thread-safe."""

    def __init__(self, server: ViserServer, *, shadows: bool = False) -> None:
        self._server = server
        self._lock = threading.Lock()
        self._cameras = CameraControl(server)
        self._floors = FloorNodes(server.scene)
        self._lines = LineNodes(server.scene)
        self._disc_nodes = DiscNodes(server.scene)
        self._solids = SolidNodes(server.scene)
        self._pins = PinNodes(server.scene)
        self._ring = Batch(server.scene, "/selected/ring", flat=True)
        self._names = LabelNodes(server.scene, "/names")
        self._agents: tuple[AgentName, ...] = ()
        self._discs: DiscTable = disc_table([])
        self._copies: list[Copies] = []
        self._texts: list[Texts] = []
        self._bounds: Bounds | None = None
        self._selected = ""
        _light(server.scene, shadows)

    def show(self, picture: Picture) -> None:
        """Show exactly this picture."""
        # Browsers receive all changes of a picture together and never show half of one.
        with self._lock, self._server.atomic():
            self._fit(picture)
            self._discs = disc_table(picture.of(Discs))
            self._copies = picture.of(Copies)
            self._texts = picture.of(Texts)
            self._floors.show(picture.of(Tiles))
            self._lines.show(picture.of(Polyline))
            self._disc_nodes.show(self._discs)
            self._solids.show(self._copies)
            self._pins.show(self._texts, self.pin_height, picture.marked())
            self._agents = agent_names(picture)
            self._encircle()

    def select(self, agent: str) -> None:
        """Mark an agent; "" for none."""
        with self._lock, self._server.atomic():
            self._selected = agent
            self._encircle()

    def clicked(
        self, origin: tuple[float, ...], direction: tuple[float, ...], eye: Eye | None = None
    ) -> Clicked | None:
        """What a ray hits; with the `eye` of its camera, also labels, which cover the world."""
        start, ray = np.array(origin), np.array(direction)
        with self._lock:
            labels = [*self._names.shown, *self._pins.labels]
            label = clicked_label(start, ray, eye, labels) if eye is not None else None
            if label is None:
                return clicked(start, ray, self._discs, self._copies, self._texts, self.pin_height)
            if not label.agent:
                return Clicked(text=label.text)
            marked = self._mark(label.agent)
            return Clicked(label.agent, marked.owner if marked is not None else "")

    @property
    def pin_height(self) -> float:
        """Height of pins in metres, proportional to the world's size."""
        bounds = self._bounds
        if bounds is None:
            return 1.0
        return 0.06 * math.hypot(bounds.right - bounds.left, bounds.top - bounds.bottom)

    def labels(self) -> tuple[str, ...]:
        """All shown texts, without duplicates."""
        return tuple(dict.fromkeys(text for batch in self._texts for text in batch.texts))

    def _fit(self, picture: Picture) -> None:
        """Point the cameras at the first picture that is not empty."""
        if self._bounds is not None:
            return
        self._bounds = bounds_of(picture)
        if self._bounds is not None:
            heights = [matrix.form.height for matrix in picture.of(Tiles)]
            heights += [float(copies.extents()[1][:, 2].max()) for copies in picture.of(Copies)]
            self._cameras.fit(self._bounds, max(heights, default=0.0))

    def _encircle(self) -> None:
        """Show a ring around the selected agent, and the names of agents above them."""
        marked = self._mark(self._selected)
        places, sizes = np.zeros((0, 3)), np.zeros((0, 3))
        if marked is not None:
            places, sizes = np.array([marked.low]), np.array([[marked.radius] * 2 + [1.0]])
        color: Any = np.tile(np.array(_ACCENT, np.uint8), (len(places), 1))
        self._ring.show(ring(), places, upright(np.zeros(len(places))), sizes, color)
        # High enough to leave the discs, as seen from the first position of the camera, uncovered.
        above = _NAME_HEIGHT * self.pin_height
        labels = [
            PageLabel(name.text, (name.x, name.y, name.height + above), agent=name.text)
            for name in self._agents
        ]
        if marked is not None and self._selected not in {label.agent for label in labels}:
            x, y, _ = marked.low
            place = x, y, marked.top + above
            labels.append(PageLabel(self._selected, place, agent=self._selected))
        self._names.show(labels)

    def _mark(self, agent: str) -> _Mark | None:
        """Where an agent's disc is, or else its first solid; None without either."""
        discs, row = self._discs, self._row(agent)
        if row >= 0:
            low = float(discs.x[row]), float(discs.y[row]), _RING_LEVEL
            radius, top = 1.25 * float(discs.radius[row]), float(discs.height[row])
            return _Mark(discs.owner(row), low, radius, top)
        for copies in self._copies if agent else ():
            solid = next((at for at in range(len(copies)) if copies.agent(at) == agent), -1)
            if solid >= 0:
                low, high = (edge[solid] for edge in copies.extents())
                x, y = ((low + high) / 2)[:2].tolist()
                radius = float(np.hypot(*(high - low)[:2])) / 2
                below = x, y, float(low[2]) + _RING_LEVEL
                return _Mark(copies.owners[solid], below, 1.1 * radius, float(high[2]))
        return None

    def _row(self, agent: str) -> int:
        """The row of an agent's disc, preferably one with a heading; -1 for none."""
        if not agent:
            return -1
        discs = self._discs
        rows = [row for row in range(len(discs)) if discs.agent(row) == agent]
        headed = [row for row in rows if discs.heading[row]]
        return next(iter(headed or rows), -1)


def _light(scene: SceneApi, shadows: bool) -> None:
    """Light from the sky and the sun.

    An environment map would make software rendering several times slower.
    """
    scene.set_up_direction("+z")
    scene.world_axes.visible = False
    scene.configure_environment_map(hdri=None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere(
        "/lights/sky", sky_color=(255, 255, 255), ground_color=(180, 185, 195), intensity=2.4
    )
    scene.add_light_directional(
        "/lights/sun", intensity=1.7, position=(4.0, -3.0, 10.0), cast_shadow=shadows
    )


Array = NDArray[Any]
MANY_COPIES = 1000
"""Number of copies from which each needs fewer sides and casts no shadow."""


class Batch:
    """Copies of a solid; unchanged data are not sent again."""

    def __init__(self, scene: SceneApi, name: str, *, flat: bool = False) -> None:
        self._scene = scene
        self._name = name
        self._flat = flat
        self._solid: Solid | None = None
        self._node: BatchedMeshHandle | None = None

    def show(
        self, solid: Solid, positions: Array, turns: Array, scales: Array, colors: Array
    ) -> None:
        """Show copies: positions (n, 3), rotations (n, 4), scales (n, 3), colours (n, 3)."""
        if solid is not self._solid or not len(positions):
            self.remove()
        if not len(positions):
            return
        self._solid = solid
        if self._node is None:
            self._node = self._added(solid, positions, turns, scales, colors)
            return
        self._node.batched_positions = positions.astype(np.float32)
        self._node.batched_wxyzs = turns.astype(np.float32)
        self._node.batched_scales = scales.astype(np.float32)
        self._node.batched_colors = _linear(colors)

    def remove(self) -> None:
        """Show none."""
        if self._node is not None:
            self._node.remove()
            self._node = None

    def _added(
        self, solid: Solid, positions: Array, turns: Array, scales: Array, colors: Array
    ) -> BatchedMeshHandle:
        return self._scene.add_batched_meshes_simple(
            self._name,
            solid.vertices,
            solid.faces,
            turns.astype(np.float32),
            positions.astype(np.float32),
            batched_scales=scales.astype(np.float32),
            batched_colors=_linear(colors),
            lod="off",
            flat_shading=False,
            side="double" if self._flat else "front",
            cast_shadow=not self._flat and len(positions) < MANY_COPIES,
            receive_shadow=False,
        )


def _linear(colors: Array) -> NDArray[np.uint8]:
    """Linear light of sRGB colours: browsers expect that for instances, but sRGB for meshes."""
    shares = colors / 255.0
    light = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return np.round(255 * light).astype(np.uint8)


_MARK = (255, 255, 255)


class DiscNodes:
    """The nodes of all discs."""

    def __init__(self, scene: SceneApi) -> None:
        self._bodies = Batch(scene, "/movers/bodies")
        self._marks = Batch(scene, "/movers/headings", flat=True)

    def show(self, discs: DiscTable) -> None:
        """Show exactly these."""
        ground = np.zeros(len(discs))
        turns = upright(discs.angle)
        scales = np.stack([discs.radius, discs.radius, discs.height], axis=1)
        places = np.stack([discs.x, discs.y, ground], axis=1)
        solid = cylinder(32 if len(discs) < MANY_COPIES else 8)
        self._bodies.show(solid, places, turns, scales, discs.color)
        marked = discs.heading
        on_top = np.stack([discs.x, discs.y, discs.mark_height], axis=1)[marked]
        white = np.broadcast_to(np.array(_MARK, np.uint8), (len(on_top), 3))
        self._marks.show(arrow(), on_top, turns[marked], scales[marked], white)


class SolidNodes:
    """The nodes of copies of solids: one for each solid."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._batches: list[Batch] = []

    def show(self, groups: list[Copies]) -> None:
        """Show exactly these."""
        while len(self._batches) < len(groups):
            self._batches.append(Batch(self._scene, f"/solids/{len(self._batches)}"))
        for batch in self._batches[len(groups) :]:
            batch.remove()
        for copies, batch in zip(groups, self._batches, strict=False):
            batch.show(copies.solid, copies.places, copies.turns, copies.sizes, copies.color)


class LineNodes:
    """The nodes of all lines."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._shown: dict[str, tuple[Polyline, LineSegmentsHandle]] = {}

    def show(self, lines: list[Polyline]) -> None:
        """Show exactly these."""
        names: dict[str, Polyline] = {}
        counts: dict[str, int] = {}
        for line in lines:
            counts[line.owner] = counts.get(line.owner, 0) + 1
            if len(line.points) > 1:
                names[f"/lines/{line.owner or 'world'}/{counts[line.owner]}"] = line
        for name in [name for name in self._shown if name not in names]:
            self._shown.pop(name)[1].remove()
        for name, line in names.items():
            self._show(name, line)

    def _show(self, name: str, line: Polyline) -> None:
        before, node = self._shown.get(name, (None, None))
        if before is line:
            return
        if node is not None and before is not None and before.form == line.form:
            node.points = segments(line)
        else:
            node = self._scene.add_line_segments(
                name, segments(line), np.array(rgb(line.form.color)), thickness=line.form.width
            )
        self._shown[name] = line, node


_Nodes: TypeAlias = "list[MeshHandle | ImageHandle]"


class FloorNodes:
    """Nodes of all matrices, rebuilt only when a matrix changes."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._shown: dict[str, tuple[Floor, _Nodes]] = {}

    def show(self, matrices: list[Tiles]) -> None:
        """Show exactly these."""
        floors = named_floors(matrices)
        for name in [name for name in self._shown if name not in floors]:
            for node in self._shown.pop(name)[1]:
                node.remove()
        for name, floor in floors.items():
            self._show(name, floor)

    def _show(self, name: str, floor: Floor) -> None:
        before, nodes = self._shown.get(name, (None, []))
        if before is not None and before.is_same(floor):
            return
        # Only an image can be replaced in place; meshes are built again. A floor without coloured
        # cells has no node at all.
        node = nodes[0] if nodes and before is not None and before.is_at(floor) else None
        if isinstance(node, ImageHandle):
            node.image = image(floor.tiles)
        else:
            for node in nodes:
                node.remove()
            build = self._built if floor.tiles.form.height else self._laid
            nodes = build(name, floor)
        self._shown[name] = floor, nodes

    def _built(self, name: str, floor: Floor) -> _Nodes:
        """A floor with walls where cells are above 0."""
        pose, form = floor.tiles.pose, floor.tiles.form
        return [
            self._scene.add_mesh_simple(
                f"{name}/{mesh.name}",
                mesh.solid.vertices,
                mesh.solid.faces,
                color=mesh.color,
                opacity=form.opacity if form.opacity < 1 else None,
                flat_shading=True,
                cast_shadow=mesh.walls,
                position=(pose.x, pose.y, 0.0),
                wxyz=upright(pose.angle),
            )
            for mesh in floor_meshes(floor.tiles)
        ]

    def _laid(self, name: str, floor: Floor) -> _Nodes:
        """An image that lies on the ground."""
        tiles = floor.tiles
        width, depth = tiles.size
        middle = tiles.pose.then(width / 2, depth / 2)
        laid = self._scene.add_image(
            name,
            image(tiles),
            width,
            depth,
            # JPEG has no transparency.
            format="png",
            cast_shadow=False,
            receive_shadow=False,
            position=(middle.x, middle.y, floor.height),
            wxyz=upright(tiles.pose.angle),
        )
        return [laid]


# viser's font in pixels at scale 1, and measures of a label in that font size.
_FONT_PIXELS = 12.0
_LETTER_WIDTH, _PADDING, _LABEL_HEIGHT = 0.62, 0.4, 1.5
_PAGE_HEIGHT = 800.0
"""Assumed height of a page in pixels of the style sheet.

Browsers send the height of their drawing buffer, which depends on the screen's pixel ratio and on
the load. On a page of another height, the clickable area of a label is larger or smaller than the
label.
"""


@dataclass(frozen=True, slots=True)
class PageLabel:
    """A text whose lower edge is at a position in metres; `agent` if it names one."""

    text: str
    position: Point
    scale: float = 1.0
    agent: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """A browser's camera: its axes (3,), and the side of a pixel per metre of distance."""

    ahead: NDArray[Any]
    right: NDArray[Any]
    up: NDArray[Any]
    pixel: float

    @staticmethod
    def of(camera: Any) -> Eye:
        """The eye of viser's camera."""
        ahead = np.asarray(camera.look_at) - np.asarray(camera.position)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, np.asarray(camera.up_direction))
        right = right / np.linalg.norm(right)
        pixel = 2 * math.tan(camera.fov / 2) / _PAGE_HEIGHT
        return Eye(ahead, right, np.cross(right, ahead), pixel)


class LabelNodes:
    """The nodes of a list of labels."""

    def __init__(self, scene: SceneApi, folder: str) -> None:
        self._scene = scene
        self._folder = folder
        self._nodes: list[LabelHandle] = []
        self.shown: Sequence[PageLabel] = ()

    def show(self, labels: Sequence[PageLabel]) -> None:
        """Show exactly these; only changes are sent."""
        before, self.shown = self.shown, labels
        while len(self._nodes) > len(labels):
            self._nodes.pop().remove()
        for number, label in enumerate(labels):
            if number == len(self._nodes):
                self._nodes.append(
                    self._scene.add_label(
                        f"{self._folder}/{number}",
                        label.text,
                        position=label.position,
                        anchor="bottom-center",
                        font_screen_scale=label.scale,
                    )
                )
            elif label != before[number]:
                node = self._nodes[number]
                node.text, node.position = label.text, label.position
                node.font_screen_scale = label.scale


def clicked_label(
    origin: NDArray[Any], direction: NDArray[Any], eye: Eye, labels: Sequence[PageLabel]
) -> PageLabel | None:
    """The nearest label that a ray from the camera hits."""
    along = float(direction @ eye.ahead)
    hits: list[tuple[float, int]] = []
    for number, label in enumerate(labels):
        place = np.array(label.position)
        depth = float((place - origin) @ eye.ahead)
        if depth <= 0 or along <= 0:
            continue
        # A label faces the camera, so its plane is at one depth.
        beside = (origin + direction * (depth / along) - place) / (depth * eye.pixel)
        em = _FONT_PIXELS * label.scale
        width, height = em * (_LETTER_WIDTH * len(label.text) + _PADDING), em * _LABEL_HEIGHT
        if abs(float(beside @ eye.right)) <= width / 2 and 0 <= float(beside @ eye.up) <= height:
            hits.append((depth, number))
    return labels[min(hits)[1]] if hits else None


MAX_LABELS = 300
_MARKED = 1.35
"""Relative size of marked pins and labels."""


class PinNodes:
    """The nodes of all texts; only the first MAX_LABELS have a label."""

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._pins = Batch(scene, "/pins")
        self._labels = LabelNodes(scene, "/labels")
        self._shown: tuple[list[Texts], float, Mapping[str, str]] = [], 0.0, {}

    @property
    def labels(self) -> Sequence[PageLabel]:
        """The labels shown."""
        return self._labels.shown

    def show(self, texts: list[Texts], height: float, marked: Mapping[str, str]) -> None:
        """Show exactly these, on pins of a height in metres; `marked` are larger and recoloured."""
        before, high, were = self._shown
        # Pins rarely change, and sending them costs far more than this comparison.
        if (
            (high, were) == (height, marked)
            and len(before) == len(texts)
            and all(map(_is, before, texts))
        ):
            return
        self._shown = texts, height, marked
        names = [text for batch in texts for text in batch.texts]
        places = np.array(
            [(x, y, 0.0) for batch in texts for x, y in zip(batch.x, batch.y, strict=True)]
        ).reshape(-1, 3)
        colors = [
            rgb(marked.get(text, batch.form.color)) for batch in texts for text in batch.texts
        ]
        sizes = np.array([_MARKED if text in marked else 1.0 for text in names])
        self._pins.show(
            pin(),
            places,
            upright(np.zeros(len(places))),
            np.tile(height * sizes[:, None], (1, 3)),
            np.array(colors, np.uint8).reshape(-1, 3),
        )
        self._labels.show(
            [
                PageLabel(text, (x, y, 1.12 * height * size), size)
                for text, (x, y, _), size in zip(
                    names[:MAX_LABELS], places.tolist(), sizes.tolist(), strict=False
                )
            ]
        )


def _is(first: Texts, second: Texts) -> bool:
    return first is second
