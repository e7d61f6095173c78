"""Cameras and streams: always the newest image, read in a thread that may block."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

from minerva_bus.world.readings import Sightings
from minerva_services.bridging import SourceError
from minerva_services.sensors.vision.images import grey
from minerva_services.sensors.vision.library import opencv
from minerva_services.sensors.vision.video import MarkerFinder

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
