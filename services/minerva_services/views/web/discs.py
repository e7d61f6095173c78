"""Discs on the page: cylinders, with a heading mark where they have one."""

from __future__ import annotations

import numpy as np
from viser import SceneApi

from minerva_services.views.disc_table import DiscTable
from minerva_services.views.solids import arrow, cylinder, upright
from minerva_services.views.web.batch import MANY_COPIES, Batch

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
