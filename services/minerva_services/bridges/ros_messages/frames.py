"""Where a robot's sensors are mounted: the tree of its fixed transforms, /tf_static [REP 105]."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.world.readings import CENTRE, Mount
from minerva_services.bridging.transforms import inverse, matrix_of, product

Matrix = NDArray[np.float64]

BASE: Final = "base_link"
_OPTICAL: Final = "optical_frame"
_DIGITS: Final = 6
"""Of a mount's metres and degrees: what is less is of the arithmetic, and not of the robot."""


@dataclass(frozen=True, slots=True)
class Mounting:
    """A sensor's mount in the plane; `flipped`: it hangs upside down, so left is right."""

    mount: Mount = CENTRE
    flipped: bool = False


class Frames:
    """Transforms by the frame that they place; a later one replaces an earlier one."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Matrix]] = {}

    def hear(self, message: Any) -> None:
        """Take a TFMessage's transforms, those that are finite."""
        for one in message.transforms:
            matrix = matrix_of(one.transform)
            if np.isfinite(matrix).all():
                self._parents[_bare(one.child_frame_id)] = _bare(one.header.frame_id), matrix

    def matrix(self, base: str, frame: str) -> Matrix | None:
        """The transform from a frame to the base, 4 x 4; None where they are not connected."""
        base, frame = _bare(base), _bare(frame)
        above = dict(self._above(base))
        for name, matrix in self._above(frame):
            if name in above:
                return product(inverse(above[name]), matrix)
        return None

    def mounting(self, base: str, frame: str) -> Mounting | None:
        """How a sensor of this frame sits on the base; None where that is not known.

        An optical frame looks along its z axis, others along x.
        """
        matrix = self.matrix(base, frame)
        if matrix is None:
            return None
        ahead = 2 if _bare(frame).endswith(_OPTICAL) else 0
        angle = np.degrees(portable.atan2(matrix[1, ahead], matrix[0, ahead]))
        numbers = (matrix[0, 3], matrix[1, 3], angle)
        mount = Mount(*[round(float(one), _DIGITS) + 0.0 for one in numbers])
        return Mounting(mount, flipped=bool(not ahead and matrix[2, 2] < 0))

    def on_its_robot(self, frame: str) -> Mounting:
        """How a sensor sits on the `base_link` above it, or else on the last frame above it."""
        base = frame
        for base, _ in self._above(_bare(frame)):
            if base.rpartition("/")[2] == BASE:
                break
        found = self.mounting(base, frame) if base != _bare(frame) else None
        return found or Mounting()

    def _above(self, frame: str) -> Iterator[tuple[str, Matrix]]:
        """A frame and all that it hangs on, each with the transform to it."""
        matrix, seen = np.eye(4), set[str]()
        while frame not in seen:
            yield frame, matrix
            seen.add(frame)
            if frame not in self._parents:
                return
            frame, upward = self._parents[frame]
            matrix = product(upward, matrix)


def _bare(frame: str) -> str:
    return frame.lstrip("/")
