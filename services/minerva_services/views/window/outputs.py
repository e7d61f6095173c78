"""Output of a view without a window: PNG files, replaced or one per view, or a video."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

from minerva_bus.files import ending_of, text_of_path, write_output
from minerva_services.views.svg.files import numbered, prepare_folder
from minerva_services.views.window.options import WindowOptions
from minerva_services.views.window.painter import Pixels
from minerva_services.views.window.video import Timing, VideoWriter


class PngWriter:
    """Writes PNG files. Raises MisuseError if they cannot be written."""

    def __init__(self, path: str, keeps_all: bool) -> None:
        self._path = Path(path)
        self._keeps_all = keeps_all
        self.written: Path | None = None
        prepare_folder(self._path)

    def add(self, frame: int, pixels: Pixels) -> None:
        """Write a picture of shape (height, width, 3)."""
        path = numbered(self._path, frame) if self._keeps_all else self._path
        write_output(path, png(pixels), "picture")
        self.written = path


def png(pixels: Pixels) -> bytes:
    """RGB pixels of shape (height, width, 3) as PNG."""
    import pygame

    height, width, _ = pixels.shape
    surface = pygame.image.frombuffer(pixels.tobytes(), (width, height), "RGB")
    file = io.BytesIO()
    pygame.image.save(surface, file, "picture.png")
    return file.getvalue()


Draw = Callable[[], Pixels]
"""Draws the current view. Called only for views that are written."""


class Output(Protocol):
    """A destination of drawn views."""

    def add(self, frame: int, draw: Draw) -> None:
        """Write the view of a frame. Raises MisuseError."""
        ...

    def report(self) -> Mapping[str, str]:
        """The file written, if any."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


class PictureOutput:
    """A PNG picture of each view."""

    def __init__(self, options: WindowOptions) -> None:
        self._writer = PngWriter(options.path, options.frames)

    def add(self, frame: int, draw: Draw) -> None:
        self._writer.add(frame, draw())

    def report(self) -> Mapping[str, str]:
        written = self._writer.written
        return {} if written is None else {"picture": text_of_path(written)}

    def close(self) -> None:
        pass


class VideoOutput:
    """A video, in which a view may be shown by several pictures or by none."""

    def __init__(self, options: WindowOptions, dt: float, every: int) -> None:
        suffix = ending_of(options.video)
        self._path = options.video
        self._timing = Timing.of(dt, options.speed, every, options.fps, suffix)
        self._writer = VideoWriter(options.video, options.size, self._timing.fps)

    def add(self, frame: int, draw: Draw) -> None:
        times = self._timing.times(frame)
        if times:
            pixels = draw()
            for _ in range(times):
                self._writer.add(pixels)

    def report(self) -> Mapping[str, str]:
        return {"video": text_of_path(self._path)} if self._writer.pictures else {}

    def close(self) -> None:
        self._writer.close()
