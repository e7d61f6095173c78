"""The vision bridge: a real camera whose marker detections become sightings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

from minerva_bus.errors import MisuseError
from minerva_bus.log.recordings import Recording, RecordingError
from minerva_bus.world.readings import Mount, Sightings
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging import Bridge, Source, SourceError
from minerva_services.options import names_in, takes_options
from minerva_services.sensors.clocks import FirstSkip
from minerva_services.sensors.playback import LAST_SECONDS, PlaybackPace, Player
from minerva_services.sensors.vision.images import (
    Grey,
    ImageFolder,
    LiveCamera,
    Video,
    is_image,
    shown,
)
from minerva_services.sensors.vision.locator import MarkerLocator, VisionOptions, WrongSize


class Vision(Bridge, when="freely"):
    """Recognises markers (ArUco, AprilTag) and publishes what each image shows as `Sightings`.

    The camera is assumed to be level. A sighting gives a marker's horizontal distance and angle
    from the robot's centre and heading.

    Args (further ones are those of `VisionOptions`):
        source: a video file, an image or a folder of them, a device (`0`, `/dev/video0`), or a
          stream (`rtsp://`, `http://`).
        robot: the id of the agent that carries the camera.
        mount_x: camera position, metres ahead of the robot's centre.
        mount_y: metres to its left.
        mount_angle: rotation in degrees, counter-clockwise.
        topic: the topic of the sightings.
        fps: images per second of a file or folder; 0: the file's own rate, 10 for a folder, and two
          per frame's dt for a single looping image.
        speed: playback speed of a file or folder; 0: as fast as possible.
        loop: start a file or folder over at its end.
        width: width in pixels requested from a device; 0: its default.
        height: height in pixels, likewise.

    """

    source_option: ClassVar[str] = "source"

    @takes_options(VisionOptions)
    def __init__(
        self,
        source: str,
        robot: str = "r1",
        mount_x: float = 0.0,
        mount_y: float = 0.0,
        mount_angle: float = 0.0,
        topic: str = "sightings",
        fps: float = 0.0,
        speed: float = 1.0,
        loop: bool = False,
        width: int = 0,
        height: int = 0,
        **vision: Any,
    ) -> None:
        super().__init__()
        options = VisionOptions(**vision)
        if not all(map(math.isfinite, (mount_x, mount_y, mount_angle))):
            raise MisuseError("vision: mount_x, mount_y and mount_angle must be numbers")
        if not 0 <= fps < math.inf or width < 0 or height < 0:
            raise MisuseError(f"vision: fps, width, height are {fps:g}, {width}, {height}; not < 0")
        self.source = f"vision: {shown(source)}"
        self._address, self._robot, self._topic, self._fps = source, robot, topic, fps
        self.concerns = names_in(robot)
        self._pace, self._size = PlaybackPace(speed, loop), (width, height)
        self._dt = math.inf  # Without a world there is no frame that an image must meet.
        self._mount = Mount(mount_x, mount_y, mount_angle)
        self._live = source.isdecimal() or source.startswith("/dev/") or "://" in source
        if not self._live and not Path(source).exists():
            raise MisuseError(f"vision: file or folder {source!r} does not exist; check the name")
        # These differ between worlds, so the instance attributes hide the class's.
        self.reconnects = self._live
        self.publishes = (topic,)
        # OpenCV takes half a second to load. Frames begin when members have joined, so it is loaded
        # before; `check` reports a missing library or calibration too.
        self._locator = MarkerLocator(options, self.count)
        self._skipped = FirstSkip(self.pass_over)

    def joined(self, world: WorldInfo) -> None:
        self._dt = world.dt
        if not self._live:
            self._recording().close()  # fail here, where an invalid file can still be reported

    def open(self) -> Source:
        if self._live:
            live = LiveCamera(self._address, self._topic, self._find, self.count, self._size)
            try:
                live.opened()
            except SourceError:
                live.close()
                raise
            return live
        try:
            recording = self._recording()
            alone, path = self._round_seconds(recording), Path(self._address)
            return Player(
                recording, self._pace, alone=alone, why_empty=lambda: self._skipped.reason(path)
            )
        except RecordingError as error:
            raise SourceError(f"vision: {error}") from None

    def _round_seconds(self, recording: Recording) -> float:
        """Display time of a single image that loops.

        A still is always in view, so it is published twice per frame of a world that keeps time:
        each frame then has it, at any phase.
        """
        if self._fps:
            return 1 / self._fps
        still = isinstance(recording, ImageFolder) and recording.is_still
        return min(LAST_SECONDS, self._dt / 2) if still else LAST_SECONDS

    def _recording(self) -> Recording:
        path = Path(self._address)
        if path.is_dir() or is_image(path):
            return ImageFolder(path, self._topic, self._find, self._skipped, self._fps)
        return Video(path, self._topic, self._find, self._fps)

    def _find(self, image: Grey, time: float) -> Sightings | None:
        try:
            return Sightings(self._robot, self._locator.locate(image, self._mount), time)
        except WrongSize as problem:
            self._skipped("wrong size", f"{self.source}: {problem}")
            return None
