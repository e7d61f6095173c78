"""Messages of sensors as readings: the same for messages of a network and of a bag."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeAlias

from minerva_bus.world.readings import Mount, Reading
from minerva_services.bridges.ros_messages import images, readings
from minerva_services.bridges.ros_messages.frames import (
    BASE,
    Frames,
    Matrix,
    SensorMount,
    UnplacedError,
    bare,
)
from minerva_services.bridges.ros_messages.messages import (
    BATTERY,
    COMPRESSED,
    DETECTIONS,
    FIX,
    IMAGE,
    LASER_SCAN,
    ODOMETRY,
    POINTS,
    RANGE,
)
from minerva_services.bridges.ros_messages.ranges import HeightBand, scan_of_points, scan_of_range

_Read: TypeAlias = Callable[[Any, str, SensorMount, float | None], Reading]

_MOUNTED: Final[Mapping[str, tuple[str, _Read]]] = {
    LASER_SCAN: ("scan", readings.scan_of),
    ODOMETRY: ("odometry", readings.odometry_of),
    IMAGE: ("image", images.image_of),
    COMPRESSED: ("image", images.file_of),
    BATTERY: ("battery", readings.battery_of),
    FIX: ("position", readings.position_of),
    RANGE: ("range", scan_of_range),
}
TOPICS: Final[Mapping[str, str]] = {
    **{kind: topic for kind, (topic, _) in _MOUNTED.items()},
    POINTS: "scan",
    DETECTIONS: "sightings",
}
"""Topics of the world by message type; rosbags uses the same names of types for ROS 1."""


@dataclass(frozen=True, slots=True)
class LivePlaces:
    """Places on the `base` of a robot whose transforms arrive; `laser` is the mount of its laser.

    Lasers and ranges wait for their transforms; without one, other sensors are at the centre.
    """

    frames: Frames
    base: str
    laser: Mount | None

    def mounting(self, kind: str, frame: str) -> SensorMount:
        """Mount of the sensor that sends messages of a type in a frame. Raises UnplacedError."""
        if kind == LASER_SCAN and self.laser is not None:
            return SensorMount(self.laser)
        mounting = self.frames.mounting(self.base, frame)
        if mounting is None and kind in (LASER_SCAN, RANGE):
            raise UnplacedError(f"no transform from {frame} to {self.base}")
        return mounting or SensorMount()

    def placed(self, frame: str) -> Matrix:
        """The transform from a frame to the robot, 4 x 4. Raises UnplacedError."""
        return self.frames.placed(self.base, frame)


@dataclass(frozen=True, slots=True)
class RecordedPlaces:
    """Places on the base above a sensor: a bag may be of any robot, and without transforms."""

    frames: Frames
    override: Callable[[Mount], Mount]

    def mounting(self, kind: str, frame: str) -> SensorMount:
        """Mount of a sensor; at the centre if it is unknown."""
        base = self.frames.base_above(frame)
        known = self.frames.mounting(base, frame) if base != bare(frame) else None
        sensor = known or SensorMount()
        return replace(sensor, mount=self.override(sensor.mount))

    def placed(self, frame: str) -> Matrix:
        """The transform from a frame to that base, 4 x 4. Raises UnplacedError."""
        base = self.frames.base_above(frame)
        # Heights of points are those above the base, which a sensor's own frame does not tell.
        if base == bare(frame) and not base.rpartition("/")[2].startswith("base"):
            raise UnplacedError(f"no transform from {frame} to {BASE}")
        return self.frames.placed(base, frame)


@dataclass(frozen=True, slots=True)
class Conversion:
    """Makes readings of a robot from messages. `band` is that of points."""

    robot: str
    places: LivePlaces | RecordedPlaces
    band: HeightBand = field(default_factory=HeightBand)

    def reading(self, kind: str, message: Any, time: float | None = None) -> Reading:
        """The reading of a message of a type; `time` replaces its own. Raises GarbageError."""
        frame = str(message.header.frame_id)
        if kind == POINTS:
            placed = self.places.placed(frame)
            return scan_of_points(message, self.robot, placed, self.band, time)
        if kind == DETECTIONS:
            return readings.sightings_of(message, self.robot, self.places.placed(frame), time)
        _, read = _MOUNTED[kind]
        return read(message, self.robot, self.places.mounting(kind, frame), time)
