"""Where a robot's sensors are mounted: the tree of its fixed transforms, /tf_static [REP 105]."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minerva_bus.world.readings import Mount
from minerva_services.bridging.transforms import matrix_of

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Mounting:
    """A sensor's mount in the plane; `flipped`: it hangs upside down, so left is right."""

    mount: Mount
    flipped: bool = False


class Frames:
    """Transforms by the frame that they place."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Matrix]] = {}

    def hear(self, message: Any) -> None:
        """Take a TFMessage's transforms."""
        for one in message.transforms:
            parent, child = _bare(one.header.frame_id), _bare(one.child_frame_id)
            self._parents[child] = parent, matrix_of(one.transform)

    def matrix(self, base: str, frame: str) -> Matrix | None:
        """The transform from a frame to the base, 4 x 4; None where they are not connected."""
        base, frame = _bare(base), _bare(frame)
        above = dict(self._above(base))
        for name, matrix in self._above(frame):
            if name in above:
                return np.linalg.inv(above[name]) @ matrix
        return None

    def mounting(self, base: str, frame: str) -> Mounting | None:
        """How a sensor of this frame sits on the base; None where that is not known."""
        matrix = self.matrix(base, frame)
        if matrix is None:
            return None
        x, y = float(matrix[0, 3]), float(matrix[1, 3])
        angle = float(np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])))
        return Mounting(Mount(x, y, angle), flipped=bool(matrix[2, 2] < 0))

    def _above(self, frame: str) -> Iterator[tuple[str, Matrix]]:
        """A frame and all that it hangs on, each with the transform to it."""
        matrix, seen = np.eye(4), set[str]()
        while frame not in seen:
            yield frame, matrix
            seen.add(frame)
            if frame not in self._parents:
                return
            frame, upward = self._parents[frame]
            matrix = upward @ matrix


def _bare(frame: str) -> str:
    return frame.lstrip("/")
