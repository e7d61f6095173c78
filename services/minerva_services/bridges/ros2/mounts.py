"""How a sensor is mounted, given by a person or told by the robot."""

from __future__ import annotations

import math

from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Mount
from minerva_services.bridges.ros_messages import Frames, GarbageError, Mounting


class UnplacedError(GarbageError):
    """A message of a sensor whose mount is not known yet."""


def mounting_of(frames: Frames, base: str, frame: str, given: Mount | None) -> Mounting:
    """How a sensor is mounted: as given, or as its frame's transform says. Raises UnplacedError."""
    if given is not None:
        return Mounting(given)
    found = frames.mounting(base, frame)
    if found is None:
        raise UnplacedError(f"no transform from {frame} to {base}")
    return found


def mount_of(text: str) -> Mount | None:
    """A mount from "x, y, degrees"; None from "". Raises MisuseError."""
    if not text.strip():
        return None
    try:
        x, y, angle = (float(part) for part in text.split(","))
    except ValueError:
        x = y = angle = math.nan
    if not all(map(math.isfinite, (x, y, angle))):
        raise MisuseError(f"ros2: mount is {text!r}; expected 'x, y, degrees'")
    return Mount(x, y, angle)
