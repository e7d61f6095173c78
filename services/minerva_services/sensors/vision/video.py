"""Videos and folders of images, as recordings of marker sightings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, TypeAlias

from minerva_bus.files import read_bytes
from minerva_bus.world.readings import Sightings
from minerva_bus.world.recordings import PassOver, Recorded, RecordingError
from minerva_services.sensors.vision.detection import Grey
from minerva_services.sensors.vision.images import NoImage, decoded, grey, is_image
from minerva_services.sensors.vision.library import opencv

FOLDER_RATE: Final = 10.0

MarkerFinder: TypeAlias = Callable[[Grey, float], Sightings | None]
"""The sightings of an image at a time in seconds; None if it cannot be used."""


class ImageFolder:
    """An image, or a folder of them in the order of names, at `fps` images per second."""

    def __init__(
        self, path: Path, topic: str, find: MarkerFinder, pass_over: PassOver, fps: float = 0.0
    ) -> None:
        """Raises RecordingError if there is no image."""
        self._topic, self._find, self._pass_over = topic, find, pass_over
        self._fps = fps or FOLDER_RATE
        self._done = 0
        self._shown: tuple[tuple[int, int], Sightings | None] | None = None
        self._paths = sorted(filter(is_image, path.iterdir())) if path.is_dir() else [path]
        if not self._paths:
            raise RecordingError(f"no image in {path}; expected .jpg or .png files")

    @property
    def is_still(self) -> bool:
        """True for a single image."""
        return len(self._paths) == 1

    @property
    def part(self) -> float:
        return self._done / len(self._paths)

    def readings(self) -> Iterator[Recorded]:
        for number, path in enumerate(self._paths):
            self._done = number + 1
            time = number / self._fps
            seen = self._seen(path, time)
            if seen is not None:
                yield Recorded(time, self._topic, seen)

    def _seen(self, path: Path, time: float) -> Sightings | None:
        try:
            return self._looked_at(path, time)
        except OSError as error:
            self._pass_over("garbage", f"{path}: {error.strerror}")
        except NoImage as problem:
            self._pass_over("garbage", f"{path}: {problem}")
        return None

    def _looked_at(self, path: Path, time: float) -> Sightings | None:
        """Sightings of an image; an unchanged still is not processed again."""
        if len(self._paths) > 1:
            return self._find(decoded(read_bytes(path)), time)
        about = path.stat()
        state = about.st_mtime_ns, about.st_size
        if self._shown is None or self._shown[0] != state:
            self._shown = state, self._find(decoded(read_bytes(path)), time)
        return self._shown[1]

    def close(self) -> None:
        """Nothing to close."""


class Video:
    """A video file, at its own rate or at `fps` images per second."""

    def __init__(self, path: Path, topic: str, find: MarkerFinder, fps: float = 0.0) -> None:
        """Raises RecordingError if it is not a video."""
        self._path, self._topic, self._find, self._fps = path, topic, find, fps
        self._number = 0
        self._open()

    def _open(self) -> None:
        cv2 = opencv()
        self._video: Any = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        if not self._video.isOpened():
            raise RecordingError(f"{self._path} is not a readable video")
        # Some containers do not state their number of images.
        self._count = max(1, int(self._video.get(cv2.CAP_PROP_FRAME_COUNT)))
        own = float(self._video.get(cv2.CAP_PROP_FPS))
        # Some files state no rate, or the time base of their stream instead.
        self._rate = self._fps or (own if 0 < own < 1000 else FOLDER_RATE)

    @property
    def part(self) -> float:
        return min(1.0, self._number / self._count)

    def readings(self) -> Iterator[Recorded]:
        if self._number:
            self._video.release()
            self._open()
        self._number = 0
        while True:
            there, pixels = self._video.read()
            if not there:
                break
            time = self._number / self._rate
            self._number += 1
            seen = self._find(grey(pixels), time)
            if seen is not None:
                yield Recorded(time, self._topic, seen)
        if not self._number:
            raise RecordingError(f"{self._path}: contains no readable image")

    def close(self) -> None:
        self._video.release()
