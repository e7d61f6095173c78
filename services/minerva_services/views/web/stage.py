"""The page's three dimensions: a tree of nodes that follows the pictures of a world."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
from viser import SceneApi, ViserServer

from minerva_bus.semantics.bounds import Bounds
from minerva_bus.semantics.picture import Discs, Picture, Polyline, Texts, Tiles
from minerva_services.views.web.batch import Batch
from minerva_services.views.web.camera import bounds_of
from minerva_services.views.web.floors import Floors
from minerva_services.views.web.lines import Lines
from minerva_services.views.web.movers import Bodies, Movers, bodies
from minerva_services.views.web.picking import Clicked, clicked
from minerva_services.views.web.pins import Pins
from minerva_services.views.web.sight import Sight
from minerva_services.views.web.solids import ring
from minerva_services.views.web.turning import upright

_ACCENT = (255, 196, 0)


class Stage:
    """Draws pictures; sends what has changed and removes what is gone. For several threads."""

    def __init__(self, server: ViserServer, *, shadows: bool = True) -> None:
        self._server = server
        self._lock = threading.Lock()
        self._sight = Sight(server)
        self._floors = Floors(server.scene)
        self._lines = Lines(server.scene)
        self._movers = Movers(server.scene)
        self._pins = Pins(server.scene)
        self._ring = Batch(server.scene, "/selected/ring", flat=True)
        self._name = server.scene.add_label(
            "/selected/name", "", anchor="bottom-center", visible=False
        )
        self._bodies: Bodies = bodies([])
        self._texts: list[Texts] = []
        self._bounds: Bounds | None = None
        self._selected = ""
        _light(server.scene, shadows)

    def show(self, picture: Picture) -> None:
        """Show a picture and nothing else."""
        with self._lock, self._server.atomic():
            self._fit(picture)
            self._bodies = bodies(picture.of(Discs))
            self._texts = picture.of(Texts)
            self._floors.show(picture.of(Tiles))
            self._lines.show(picture.of(Polyline))
            self._movers.show(self._bodies)
            self._pins.show(self._texts, self.pin_height)
            self._encircle()

    def select(self, agent: str) -> None:
        """Mark an agent; "" for none."""
        with self._lock, self._server.atomic():
            self._selected = agent
            self._encircle()

    def clicked(self, origin: tuple[float, ...], direction: tuple[float, ...]) -> Clicked | None:
        """What stands where a ray goes."""
        with self._lock:
            return clicked(
                np.array(origin), np.array(direction), self._bodies, self._texts, self.pin_height
            )

    @property
    def pin_height(self) -> float:
        """Metres: in a large world pins are large."""
        found = self._bounds
        if found is None:
            return 1.0
        return 0.06 * math.hypot(found.right - found.left, found.top - found.bottom)

    def labels(self) -> tuple[str, ...]:
        """All texts that are shown, each once."""
        return tuple(dict.fromkeys(text for one in self._texts for text in one.texts))

    def _fit(self, picture: Picture) -> None:
        """Look at the first picture in which there is something."""
        if self._bounds is not None:
            return
        self._bounds = bounds_of(picture)
        if self._bounds is not None:
            height = max([one.form.height for one in picture.of(Tiles)], default=0.0)
            self._sight.fit(self._bounds, height)

    def _encircle(self) -> None:
        """A ring around the selected agent, and its name above."""
        found, row = self._bodies, self._row()
        rows = slice(row, row + 1) if row >= 0 else slice(0, 0)
        places = np.stack([found.x, found.y, np.full(len(found), 0.05)], axis=1)[rows]
        sizes = np.stack([1.25 * found.radius] * 2 + [np.ones(len(found))], axis=1)[rows]
        color: Any = np.tile(np.array(_ACCENT, np.uint8), (len(places), 1))
        self._ring.show(ring(), places, upright(np.zeros(len(places))), sizes, color)
        self._name.visible = row >= 0
        if row >= 0:
            self._name.text = self._selected
            self._name.position = (found.x[row], found.y[row], 1.5 * found.height[row])

    def _row(self) -> int:
        """The selected agent's disc: one with a heading if it has any; -1 for none."""
        if not self._selected:
            return -1
        found = self._bodies
        rows = [row for row in range(len(found)) if found.agent(row) == self._selected]
        headed = [row for row in rows if found.heading[row]]
        return next(iter(headed or rows), -1)


def _light(scene: SceneApi, shadows: bool) -> None:
    """A bright sky and soft shadows."""
    scene.set_up_direction("+z")
    scene.world_axes.visible = False
    scene.configure_default_lights(cast_shadow=shadows)
    scene.configure_environment_map(environment_intensity=0.6)
