"""Sensor mounts, from options or from the robot's transforms."""

from __future__ import annotations

import math

from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Mount
from minerva_services.bridges.ros_messages import Frames, GarbageError, SensorMount


class UnplacedError(GarbageError):
    """A message of a sensor whose mount is not known yet."""


def mounting_of(frames: Frames, base: str, frame: str, given: Mount | None) -> SensorMount:
    """A sensor's mount: as given, or from its frame's transform. Raises UnplacedError."""
    if given is not None:
        return SensorMount(given)
    mounting = frames.mounting(base, frame)
    if mounting is None:
        raise UnplacedError(f"no transform from {frame} to {base}")
    return mounting


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
