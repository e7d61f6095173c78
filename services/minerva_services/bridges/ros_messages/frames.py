"""Mounts of a robot's sensors, from the tree of transforms, /tf_static and /tf [REP 105]."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus import portable
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.world.readings import CENTRE, Mount
from minerva_services.bridging.transforms import inverse, matrix_of, product

Matrix = NDArray[np.float64]

BASE: Final = "base_link"
_WORLD: Final = ("odom", "map", "earth", "world")
"""Begins of the names of frames above a robot, which its motion connects to it."""

_OPTICAL: Final = "optical_frame"
_DIGITS: Final = 6
"""Decimals kept of a mount's metres and degrees: smaller digits are rounding noise."""


class GarbageError(MinervaError):
    """Bytes that are not a message of their type, or a message that is not a valid reading."""


class UnplacedError(GarbageError):
    """A message of a sensor whose mount is not known yet."""


@dataclass(frozen=True, slots=True)
class SensorMount:
    """A sensor's planar mount; `flipped`: it is mounted upside down, so left is right."""

    mount: Mount = CENTRE
    flipped: bool = False


class Frames:
    """Transforms by child frame; later ones replace earlier ones."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Matrix]] = {}

    def update(self, message: Any) -> None:
        """Add the transforms of a TFMessage. Raises GarbageError after it, if any is invalid."""
        invalid = ""
        for item in message.transforms:
            try:
                matrix = matrix_of(item.transform)
            except ValueError as error:
                invalid = invalid or f"{item.child_frame_id}: {error}"
                continue
            self._parents[bare(item.child_frame_id)] = bare(item.header.frame_id), matrix
        if invalid:
            raise GarbageError(invalid)

    def matrix(self, base: str, frame: str) -> Matrix | None:
        """The transform from a frame to the base, 4 x 4; None if they are not connected."""
        base, frame = bare(base), bare(frame)
        # The base need not be the root of the tree; the first common ancestor connects both frames.
        above = dict(self._above(base))
        for name, matrix in self._above(frame):
            if name in above:
                return product(inverse(above[name]), matrix)
        return None

    def placed(self, base: str, frame: str) -> Matrix:
        """The same. Raises UnplacedError if they are not connected."""
        matrix = self.matrix(base, frame)
        if matrix is None:
            raise UnplacedError(f"no transform from {frame} to {base}")
        return matrix

    def mounting(self, base: str, frame: str) -> SensorMount | None:
        """Mount of a sensor frame on the base; None if unknown.

        An optical frame looks along its z axis, all others along x.
        """
        matrix = self.matrix(base, frame)
        if matrix is None:
            return None
        ahead = 2 if bare(frame).endswith(_OPTICAL) else 0
        angle = np.degrees(portable.atan2(matrix[1, ahead], matrix[0, ahead]))
        numbers = (matrix[0, 3], matrix[1, 3], angle)
        # Adding 0.0 turns -0.0 into 0.0.
        mount = Mount(*[round(float(number), _DIGITS) + 0.0 for number in numbers])
        return SensorMount(mount, flipped=bool(not ahead and matrix[2, 2] < 0))

    def base_above(self, frame: str) -> str:
        """The `base_link` above a frame, otherwise the topmost frame of the robot."""
        names = [(name, name.rpartition("/")[2]) for name, _ in self._above(bare(frame))]
        above = [name for name, last in names if not last.startswith(_WORLD)] or [bare(frame)]
        return next((name for name in above if name.rpartition("/")[2] == BASE), above[-1])

    def _above(self, frame: str) -> Iterator[tuple[str, Matrix]]:
        """A frame and its ancestors, each with the transform to it."""
        # Messages from different nodes may form a cycle.
        matrix, seen = np.eye(4), set[str]()
        while frame not in seen:
            yield frame, matrix
            seen.add(frame)
            if frame not in self._parents:
                return
            frame, upward = self._parents[frame]
            matrix = product(upward, matrix)


def bare(frame: str) -> str:
    """A frame without the leading slash of ROS 1."""
    return frame.lstrip("/")


def mount_of(text: str) -> Mount | None:
    """Parse "x, y, degrees"; None for "". Raises MisuseError."""
    if not text.strip():
        return None
    try:
        x, y, angle = (float(part) for part in text.split(","))
    except ValueError:
        x = y = angle = math.nan
    if not all(map(math.isfinite, (x, y, angle))):
        raise MisuseError(f"ros2: mount is {text!r}; expected 'x, y, degrees'")
    return Mount(x, y, angle)
