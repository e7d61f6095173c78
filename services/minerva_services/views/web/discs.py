"""Discs on the page: cylinders, with a heading mark where they have one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import SceneApi

from minerva_bus.semantics.picture import Discs
from minerva_services.views.web.batch import MANY_COPIES, Batch, upright
from minerva_services.views.web.solids import arrow, cylinder

# Relative growth of the height per disc, and at most over all discs.
_HEIGHT_STEP, _MAX_HEIGHT = 0.01, 0.5
_MARK = (255, 255, 255)


@dataclass(frozen=True, slots=True, eq=False)
class DiscTable:
    """All discs of a picture in columns: (n,) each, colours (n, 3).

    `height` grows slightly with each row, so that the later of two overlapping discs is visible.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    angle: NDArray[np.float64]
    radius: NDArray[np.float64]
    height: NDArray[np.float64]
    color: NDArray[np.uint8]
    heading: NDArray[np.bool_]
    parts: tuple[Discs, ...]

    def __len__(self) -> int:
        return len(self.x)

    def agent(self, row: int) -> str:
        """The agent of a disc; "" for scenery."""
        discs, row = self._locate(row)
        return discs.agent(row)

    def owner(self, row: int) -> str:
        """The fragment of a disc; "" for scenery."""
        discs, row = self._locate(row)
        return discs.owners[row]

    def _locate(self, row: int) -> tuple[Discs, int]:
        for discs in self.parts:
            if row < len(discs):
                return discs, row
            row -= len(discs)
        raise IndexError(row)


def disc_table(parts: list[Discs]) -> DiscTable:
    """The discs of a picture, in order."""

    def joined(name: str, empty: tuple[int, ...] = (0,)) -> NDArray[Any]:
        columns = [getattr(discs, name) for discs in parts]
        return np.concatenate(columns) if columns else np.zeros(empty)

    count = sum(map(len, parts))
    # The total growth is limited, or the last of many discs would be a tower.
    growth: NDArray[Any] = 1 + min(_HEIGHT_STEP, _MAX_HEIGHT / max(1, count)) * np.arange(count)
    return DiscTable(
        joined("x"),
        joined("y"),
        joined("angle"),
        joined("radius"),
        joined("height") * growth,
        joined("color", (0, 3)).astype(np.uint8),
        joined("heading").astype(np.bool_),
        tuple(parts),
    )


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
        on_top = np.stack([discs.x, discs.y, discs.height * (1 + _HEIGHT_STEP / 3)], axis=1)[marked]
        white = np.broadcast_to(np.array(_MARK, np.uint8), (len(on_top), 3))
        self._marks.show(arrow(), on_top, turns[marked], scales[marked], white)
