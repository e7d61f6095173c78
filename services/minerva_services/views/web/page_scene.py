"""The page's 3D scene: a tree of nodes that follows a world's pictures."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
from viser import SceneApi, ViserServer

from minerva_bus.semantics.picture import Discs, Picture, Polyline, Texts, Tiles
from minerva_bus.semantics.plane import Bounds
from minerva_services.views.disc_table import DiscTable, disc_table
from minerva_services.views.names import AgentName, agent_names
from minerva_services.views.solids import ring, upright
from minerva_services.views.web.batch import Batch
from minerva_services.views.web.camera_control import CameraControl, bounds_of
from minerva_services.views.web.discs import DiscNodes
from minerva_services.views.web.floors import FloorNodes
from minerva_services.views.web.labels import Eye, LabelNodes, PageLabel, clicked_label
from minerva_services.views.web.lines import LineNodes
from minerva_services.views.web.picking import Clicked, clicked
from minerva_services.views.web.pins import PinNodes

_NAME_HEIGHT = 0.3
"""Distance of an agent's name from its disc, in heights of a pin."""
_ACCENT = (255, 196, 0)


class PageScene:
    """Draws pictures; sends changes and removes what is gone. Thread-safe."""

    def __init__(self, server: ViserServer, *, shadows: bool = False) -> None:
        self._server = server
        self._lock = threading.Lock()
        self._cameras = CameraControl(server)
        self._floors = FloorNodes(server.scene)
        self._lines = LineNodes(server.scene)
        self._disc_nodes = DiscNodes(server.scene)
        self._pins = PinNodes(server.scene)
        self._ring = Batch(server.scene, "/selected/ring", flat=True)
        self._names = LabelNodes(server.scene, "/names")
        self._agents: tuple[AgentName, ...] = ()
        self._discs: DiscTable = disc_table([])
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
            self._texts = picture.of(Texts)
            self._floors.show(picture.of(Tiles))
            self._lines.show(picture.of(Polyline))
            self._disc_nodes.show(self._discs)
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
                return clicked(start, ray, self._discs, self._texts, self.pin_height)
            if not label.agent:
                return Clicked(text=label.text)
            return Clicked(label.agent, self._discs.owner(self._row(label.agent)))

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
            height = max([matrix.form.height for matrix in picture.of(Tiles)], default=0.0)
            self._cameras.fit(self._bounds, height)

    def _encircle(self) -> None:
        """Show a ring around the selected agent, and the names of agents above them."""
        discs, row = self._discs, self._row(self._selected)
        rows = slice(row, row + 1) if row >= 0 else slice(0, 0)
        places = np.stack([discs.x, discs.y, np.full(len(discs), 0.05)], axis=1)[rows]
        sizes = np.stack([1.25 * discs.radius] * 2 + [np.ones(len(discs))], axis=1)[rows]
        color: Any = np.tile(np.array(_ACCENT, np.uint8), (len(places), 1))
        self._ring.show(ring(), places, upright(np.zeros(len(places))), sizes, color)
        # High enough to leave the discs, as seen from the first position of the camera, uncovered.
        above = _NAME_HEIGHT * self.pin_height
        labels = [
            PageLabel(name.text, (name.x, name.y, name.height + above), agent=name.text)
            for name in self._agents
        ]
        if row >= 0 and self._selected not in {label.agent for label in labels}:
            x, y, top = discs.x[row], discs.y[row], discs.height[row] + above
            place = float(x), float(y), float(top)
            labels.append(PageLabel(self._selected, place, agent=self._selected))
        self._names.show(labels)

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
