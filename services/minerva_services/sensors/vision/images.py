"""Images as grey pixels, from readings, files, videos, folders, cameras and streams.

Of a camera or a stream always the newest image counts, read in a thread that may block.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.files import read_bytes
from minerva_bus.log.recordings import PassOver, Recorded, RecordingError
from minerva_bus.world.readings import Image, Sightings
from minerva_services.bridging import SourceError
from minerva_services.options import require

Grey: TypeAlias = NDArray[np.uint8]
"""An image of so many rows and columns."""


_QUIET = {
    "OPENCV_LOG_LEVEL": "SILENT",
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(1 << 26),
}


@cache
def opencv() -> Any:
    """The module cv2, silenced and limited to images of 64 megapixels.

    Raises MisuseError if it is not installed.
    """
    # OpenCV reads these variables when it is imported.
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    require("vision", "cv2", "OpenCV", "vision")
    import cv2

    library: Any = cv2
    # Set again in case cv2 was imported earlier; version 5 has another name for it.
    quieten = getattr(library, "setLogLevel", None) or library.utils.logging.setLogLevel
    quieten(0)
    return library


SUFFIXES: Final = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")


class NoImage(Exception):
    """Bytes that are not an image."""


def is_image(path: Path) -> bool:
    """True if a file has the suffix of an image."""
    return path.suffix.lower() in SUFFIXES


def grey_of(image: Image) -> Grey:
    """The grey pixels of a reading. Raises NoImage."""
    if image.encoding in ("jpeg", "png"):
        return decoded(image.data)
    if image.encoding == "32FC1":
        raise NoImage("depths have no colours")
    depth = 3 if image.encoding == "rgb8" else 1
    pixels = np.frombuffer(image.data, np.uint8)
    if pixels.size != image.width * image.height * depth:
        raise NoImage(f"{pixels.size} bytes do not match a {image.encoding} image of this size")
    rows = pixels.reshape(image.height, image.width, depth)
    # OpenCV expects blue, green, red.
    return grey(rows[:, :, ::-1] if depth == 3 else rows)


def decoded(data: bytes) -> Grey:
    """Decode a file's bytes. Raises NoImage."""
    cv2 = opencv()
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    except cv2.error:
        pixels = None
    if pixels is None:
        raise NoImage("not a readable image")
    return pixels


def grey(pixels: Any) -> Grey:
    """OpenCV pixels, (height, width) or (height, width, 1 or 3: blue, green, red), as grey."""
    cv2 = opencv()
    if pixels.ndim == 2:
        return cast("Grey", pixels)
    if pixels.shape[2] == 1:
        return cast("Grey", pixels[:, :, 0])
    # OpenCV rejects the negative strides of a reversed view.
    return cv2.cvtColor(np.ascontiguousarray(pixels), cv2.COLOR_BGR2GRAY)


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


IMAGE_SECONDS: Final = 5.0
"""Time without an image, in seconds, after which a camera or stream counts as lost."""

_POLL_SECONDS: Final = 0.2


class LiveCamera:
    """Marker sightings of a device (`0`, `/dev/video0`) or a stream (`rtsp://`, `http://`).

    Its thread keeps the newest image; images that arrive while the previous one is processed are
    counted as skipped.
    """

    def __init__(
        self,
        address: str,
        topic: str,
        find: MarkerFinder,
        count: Callable[[str], None],
        size: tuple[int, int] = (0, 0),
    ) -> None:
        """Start opening the camera; `opened` and `read` report the result."""
        self._address, self._topic, self._find, self._count = address, topic, find, count
        self._size = size
        self._news = threading.Condition()
        self._newest: Any = None
        self._failed = ""
        self._begun = time.monotonic()
        self._closed = threading.Event()
        self._opened = threading.Event()
        # A read may block for good, so the end of the process must not wait for the thread.
        threading.Thread(target=self._grab, daemon=True).start()

    def read(self, stop: threading.Event) -> Iterator[tuple[str, Sightings] | None]:
        """Sightings of each image. Raises SourceError if the camera fails or sends nothing."""
        latest = time.monotonic()
        while not stop.is_set():
            taken = self._next()
            if taken is None:
                if time.monotonic() - latest > IMAGE_SECONDS:
                    raise self._lost(f"no image for {IMAGE_SECONDS:g} s")
                yield None
                continue
            latest = time.monotonic()
            seen = self._find(grey(taken[0]), taken[1])
            if seen is not None:
                yield self._topic, seen

    def opened(self) -> None:
        """Wait until it is open. Raises SourceError if it cannot be opened."""
        in_time = self._opened.wait(2 * IMAGE_SECONDS)
        if self._failed or not in_time:
            raise self._lost(self._failed or "no response")

    def close(self) -> None:
        """Close asynchronously; the thread may still be blocked in a read."""
        self._closed.set()

    def _next(self) -> tuple[Any, float] | None:
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._failed, _POLL_SECONDS)
            taken, self._newest = self._newest, None
            if taken is None and self._failed:
                raise self._lost(self._failed)
            return taken

    def _lost(self, why: str) -> SourceError:
        return SourceError(f"vision: {shown(self._address)}: {why}")

    # --- in its own thread ---

    def _grab(self) -> None:
        camera: Any = None
        try:
            camera = self._camera()
            if not camera.isOpened():
                self._fail("cannot open")
                return
            self._opened.set()
            while not self._closed.is_set():
                there, pixels = camera.read()
                if not there:
                    self._fail("no more images")
                    return
                self._put(pixels)
        except Exception as error:  # backends of OpenCV raise many types
            self._fail(str(error))
        finally:
            # After a failure, too, so that `opened` returns at once instead of at its time-out.
            self._opened.set()
            if camera is not None:
                camera.release()

    def _camera(self) -> Any:
        cv2 = opencv()
        if "://" in self._address:
            # OpenCV's own limits are longer than the time after which a stream counts as lost.
            limit = round(IMAGE_SECONDS * 1000)
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, limit, cv2.CAP_PROP_READ_TIMEOUT_MSEC, limit]
            return cv2.VideoCapture(self._address, cv2.CAP_FFMPEG, limits)
        is_number = self._address.isdecimal()
        camera = cv2.VideoCapture(int(self._address) if is_number else self._address)
        for which, pixels in zip(("WIDTH", "HEIGHT"), self._size, strict=True):
            if pixels:
                camera.set(getattr(cv2, f"CAP_PROP_FRAME_{which}"), pixels)
        return camera

    def _put(self, pixels: Any) -> None:
        with self._news:
            if self._newest is not None:
                self._count("skipped")
            # The time of arrival: detection may begin much later.
            self._newest = pixels, time.monotonic() - self._begun
            self._news.notify()

    def _fail(self, why: str) -> None:
        with self._news:
            self._failed = why
            self._news.notify()


def shown(address: str) -> str:
    """An address without a password that it may contain."""
    scheme, separator, rest = address.partition("://")
    return scheme + separator + rest.rpartition("@")[2] if separator else address
