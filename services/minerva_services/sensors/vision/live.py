"""Cameras and streams: always the newest image, read in a thread that may be stuck."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

from minerva_bus.world.readings import Sightings
from minerva_services.bridging import SourceError
from minerva_services.sensors.vision.images import grey
from minerva_services.sensors.vision.library import opencv
from minerva_services.sensors.vision.video import Sees

PATIENCE: Final = 5.0
"""Seconds without an image after which a camera or a stream is lost."""

_TURN: Final = 0.2


class Live:
    """What a device (`0`, `/dev/video0`) or a stream (`rtsp://`, `http://`) shows of markers.

    Its thread reads what comes and keeps the newest image; what nobody had the time to look at is
    counted as skipped.
    """

    def __init__(
        self,
        address: str,
        topic: str,
        sees: Sees,
        count: Callable[[str], None],
        size: tuple[int, int] = (0, 0),
    ) -> None:
        """Begin to open it: `read` says how that went."""
        self._address, self._topic, self._sees, self._count = address, topic, sees, count
        self._size = size
        self._news = threading.Condition()
        self._newest: Any = None
        self._failed = ""
        self._begun = time.monotonic()
        self._closed = threading.Event()
        self._opened = threading.Event()
        threading.Thread(target=self._grab, daemon=True).start()

    def read(self, stop: threading.Event) -> Iterator[tuple[str, Sightings] | None]:
        """What each image shows. Raises SourceError where the camera fails or falls silent."""
        heard = time.monotonic()
        while not stop.is_set():
            taken = self._next()
            if taken is None:
                if time.monotonic() - heard > PATIENCE:
                    raise self._lost(f"no image for {PATIENCE:g} s")
                yield None
                continue
            heard = time.monotonic()
            seen = self._sees(grey(taken[0]), taken[1])
            if seen is not None:
                yield self._topic, seen

    def opened(self) -> None:
        """Wait until it is open. Raises SourceError where it cannot be opened."""
        in_time = self._opened.wait(2 * PATIENCE)
        if self._failed or not in_time:
            raise self._lost(self._failed or "it does not answer")

    def close(self) -> None:
        """Let go of it; its thread does so as soon as it can."""
        self._closed.set()

    def _next(self) -> tuple[Any, float] | None:
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._failed, _TURN)
            taken, self._newest = self._newest, None
            if taken is None and self._failed:
                raise self._lost(self._failed)
            return taken

    def _lost(self, why: str) -> SourceError:
        return SourceError(f"vision: {shown(self._address)}: {why}")

    # --- in a thread of its own ---

    def _grab(self) -> None:
        camera: Any = None
        try:
            camera = self._camera()
            if not camera.isOpened():
                self._fail("it cannot be opened")
                return
            self._opened.set()
            while not self._closed.is_set():
                there, pixels = camera.read()
                if not there:
                    self._fail("no more images come")
                    return
                self._put(pixels)
        except Exception as error:  # OpenCV may raise whatever its backends do.
            self._fail(str(error))
        finally:
            self._opened.set()
            if camera is not None:
                camera.release()

    def _camera(self) -> Any:
        cv2 = opencv()
        if "://" in self._address:
            limit = round(PATIENCE * 1000)
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
            self._newest = pixels, time.monotonic() - self._begun
            self._news.notify()

    def _fail(self, why: str) -> None:
        with self._news:
            self._failed = why
            self._news.notify()


def shown(address: str) -> str:
    """An address without a password that may stand in it."""
    scheme, separator, rest = address.partition("://")
    return scheme + separator + rest.rpartition("@")[2] if separator else address
