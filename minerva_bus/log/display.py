"""Channels of a record for other tools: poses, maps, log lines and sensor data in JSON."""

from __future__ import annotations

from typing import Final

from minerva_bus.frame.description import WorldSpec
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.mcap_file import McapFile
from minerva_bus.log.places import Surveyor
from minerva_bus.log.sensing import encode_transform, shown_readings
from minerva_bus.log.showing import encode_maps, encode_poses

SHOWN: Final = 500
"""Agents of a kind whose poses are shown; of a larger kind, every n-th agent."""

SHOWN_EVERY: Final = 0.1
"""Seconds of world time between two shown poses of an agent."""


class Display:
    """Writes the channels for other tools; Minerva's own readers ignore them."""

    def __init__(self, file: McapFile, world: WorldSpec) -> None:
        self._file = file
        self._world = world
        self._surveyor = Surveyor(world.vocabulary, SHOWN)
        self._last_shown = -SHOWN_EVERY
        self._robots: set[str] = set()
        for kind in self._surveyor.placed:
            file.register(c.POSES + kind, "foxglove.PosesInFrame")

    def maps(self) -> None:
        """Write the rasters of the initial string."""
        for grid in encode_maps(self._world.scene, self._world.vocabulary):
            self._file.put(c.MAP, grid, 0, 0.0)

    def poses(self, scene: Scene, frame: int, seconds: float) -> None:
        """Write the poses before a frame, if they are due: of agents, and of robots that sense."""
        now, time = frame * self._world.dt, c.time_of(frame, self._world.dt)
        if now - self._last_shown < SHOWN_EVERY:
            return
        self._last_shown = now
        for kind, places in self._surveyor.places(scene).items():
            self._file.put(c.POSES + kind, encode_poses(time, places), frame, seconds)
            for robot, x, y, angle in places.of(self._robots) if self._robots else ():
                self._file.register(c.TRANSFORMS, "foxglove.FrameTransform")
                data = encode_transform(robot, time, x, y, angle)
                self._file.put(c.TRANSFORMS, data, frame, seconds)

    def readings(self, message: Readings, frame: int, seconds: float) -> None:
        """Write readings that arrived during a frame."""
        for schema, data in shown_readings(message, c.time_of(frame, self._world.dt)):
            topic = f"{c.TOPICS}{message.topic}/{message.member}/{schema.partition('.')[2]}"
            self._file.register(topic, schema)
            self._file.put(topic, data, frame, seconds, frame)
        # Only robots that sense need transforms: other tools place sensor data by them.
        self._robots.update(reading.robot for reading in message.readings)
