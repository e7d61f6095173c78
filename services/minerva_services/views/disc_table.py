"""All discs of a picture in one table, for 3D views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.semantics.picture import Discs

HEIGHT_STEP = 0.01
"""Relative growth of the height per disc."""
_MAX_HEIGHT = 0.5
"""Relative growth of the height over all discs, at most."""


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

    @property
    def mark_height(self) -> NDArray[np.float64]:
        """Heights of the heading marks in metres (n,), slightly above the discs."""
        return self.height * (1 + HEIGHT_STEP / 3)

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
    growth: NDArray[Any] = 1 + min(HEIGHT_STEP, _MAX_HEIGHT / max(1, count)) * np.arange(count)
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
