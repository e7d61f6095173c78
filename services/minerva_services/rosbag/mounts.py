"""Where sensors sit, from the transforms of /tf_static (tf2_msgs/TFMessage)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.world.readings import CENTRE, Mount
from minerva_services.bridging.transforms import matrix_of

BASE: Final = "base_link"
_OPTICAL: Final = "optical_frame"


@dataclass(slots=True)
class Frames:
    """Frames by name: each one's parent, and where in it the frame is, (4, 4)."""

    _parents: dict[str, tuple[str, NDArray[np.float64]]] = field(
        default_factory=dict[str, tuple[str, NDArray[np.float64]]]
    )

    def learn(self, transforms: Iterable[Any]) -> None:
        """Take the transforms of a message; a later one replaces an earlier one."""
        for one in transforms:
            matrix = matrix_of(one.transform)
            if np.isfinite(matrix).all():
                self._parents[_name(one.child_frame_id)] = _name(one.header.frame_id), matrix

    def mount(self, frame: str) -> tuple[Mount, bool]:
        """Where a sensor's frame sits on its robot, and whether it hangs upside down.

        On the robot's `base_link`, or else on the last frame above it. An optical frame looks
        along its z axis, others along x. A frame that is not known is at the centre.
        """
        name, placed, seen = _name(frame), np.eye(4), set[str]()
        ahead = 2 if name.endswith(_OPTICAL) else 0
        while name in self._parents and name not in seen and _last(name) != BASE:
            seen.add(name)
            name, matrix = self._parents[name]
            placed = matrix @ placed
        if not seen:
            return CENTRE, False
        angle = math.degrees(math.atan2(placed[1, ahead], placed[0, ahead]))
        x, y = placed[0, 3], placed[1, 3]
        mount = Mount(*[round(float(one), 6) + 0.0 for one in (x, y, angle)])
        return mount, bool(not ahead and placed[2, 2] < 0)


def _name(frame: str) -> str:
    return frame.lstrip("/")


def _last(frame: str) -> str:
    return frame.rpartition("/")[2]
