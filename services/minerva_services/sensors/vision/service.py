"""The vision bridge: a camera of the real world, whose markers are sightings."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from minerva_bus.errors import MisuseError
from minerva_bus.world.readings import Mount, Sightings
from minerva_bus.world.recordings import Recording, RecordingError
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, Source, SourceError
from minerva_services.sensors.playing import ALONE, Pace, Player
from minerva_services.sensors.vision.detecting import Grey
from minerva_services.sensors.vision.eye import Eye, Look, WrongSize, names_of
from minerva_services.sensors.vision.images import is_image
from minerva_services.sensors.vision.live import Live, shown
from minerva_services.sensors.vision.video import Pictures, Video


class Vision(Bridge, lockstep=False):
    """Sees markers (ArUco, AprilTag) and publishes what each image shows as `Sightings`.

    The camera looks level. Of a marker its distance over the ground and its angle are told, from
    the robot's centre and heading.

    Args:
        source: a video file, an image or a folder of them, a device (`0`, `/dev/video0`), or a
            stream (`rtsp://`, `http://`).
        dictionary: that the markers are of, as `6X6_250` or `APRILTAG_36h11`.
        size: metres, the side of a marker's black square.
        robot: the id of the agent that carries the camera.
        names: the world's names of markers by their numbers; by default the numbers.
        calibration: a calibration file of OpenCV or ROS.
        fx: pixels, the focal length, in place of a file.
        fy: pixels; 0: as fx.
        cx: pixels, the optical centre; 0: the middle of the image.
        cy: pixels, likewise.
        mount_x: metres that the camera sits ahead of the robot's centre.
        mount_y: metres to its left.
        mount_angle: degrees that it is turned counter-clockwise.
        topic: where the sightings go.
        fps: images a second of a file or a folder; 0: the file's own, 10 of a folder, and two in
            each frame's dt of one image that loops.
        speed: of a file or a folder, so many times as fast; 0: as fast as it goes.
        loop: a file or a folder: from its end on again from its beginning.
        width: pixels that a device is asked for; 0: its own.
        height: pixels, likewise.

    """

    source_option: ClassVar[str] = "source"

    def __init__(
        self,
        source: str,
        dictionary: str,
        size: float,
        robot: str = "r1",
        names: Mapping[str, Any] | None = None,
        calibration: str = "",
        fx: float = 0.0,
        fy: float = 0.0,
        cx: float = 0.0,
        cy: float = 0.0,
        mount_x: float = 0.0,
        mount_y: float = 0.0,
        mount_angle: float = 0.0,
        topic: str = "sightings",
        fps: float = 0.0,
        speed: float = 1.0,
        loop: bool = False,
        width: int = 0,
        height: int = 0,
    ) -> None:
        super().__init__()
        self._look = Look(dictionary, size, names_of(names), calibration, fx, fy, cx, cy)
        if not all(map(math.isfinite, (mount_x, mount_y, mount_angle))):
            raise MisuseError("vision: mount_x, mount_y and mount_angle must be numbers")
        if not 0 <= fps < math.inf or width < 0 or height < 0:
            raise MisuseError(f"vision: fps, width, height are {fps:g}, {width}, {height}; not < 0")
        self.source = f"vision: {shown(source)}"
        self._address, self._robot, self._topic, self._fps = source, robot, topic, fps
        self._pace, self._size = Pace(speed, loop), (width, height)
        self._mount = Mount(mount_x, mount_y, mount_angle)
        self._live = source.isdecimal() or source.startswith("/dev/") or "://" in source
        if not self._live and not Path(source).exists():
            raise MisuseError(f"vision: there is no file or folder {source!r}; check its name")
        # Of these it is up to each world, so they hide the class's.
        self.reconnects = self._live
        self.publishes = (topic,)

    def joined(self, world: WorldInfo) -> None:
        self._eye = Eye(self._look, self.count)
        self._dt = world.dt
        if not self._live:
            self._recording().close()  # Here, where what is wrong with a file can still be said.

    def open(self) -> Source:
        if self._live:
            live = Live(self._address, self._topic, self._sees, self.count, self._size)
            try:
                live.opened()
            except SourceError:
                live.close()
                raise
            return live
        try:
            recording = self._recording()
            return Player(recording, self._pace, alone=self._round_seconds(recording))
        except RecordingError as error:
            raise SourceError(f"vision: {error}") from None

    def _round_seconds(self, recording: Recording) -> float:
        """How long one image lasts that is shown again and again.

        A still is always in view, so it is told twice in each frame of a world that keeps time:
        each frame then has it, wherever between two frames it comes.
        """
        if self._fps:
            return 1 / self._fps
        still = isinstance(recording, Pictures) and recording.is_still
        return min(ALONE, self._dt / 2) if still else ALONE

    def _recording(self) -> Recording:
        path = Path(self._address)
        if path.is_dir() or is_image(path):
            return Pictures(path, self._topic, self._sees, self._pass_over, self._fps)
        return Video(path, self._topic, self._sees, self._fps)

    def _sees(self, image: Grey, time: float) -> Sightings | None:
        try:
            return Sightings(self._robot, self._eye.sees(image, self._mount), time)
        except WrongSize as problem:
            self._pass_over("wrong size", f"{self.source}: {problem}")
            return None

    def _pass_over(self, what: str, line: str) -> None:
        """Count what is passed over, and tell of the first of its kind."""
        if what not in self._counts:
            sys.stdout.write(f"{line}; more of these are counted as {what!r}\n")
            sys.stdout.flush()
        self.count(what)
