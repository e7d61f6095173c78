"""Pictures as PNG files: one that is replaced, or one per view."""

from __future__ import annotations

import io
from pathlib import Path

from minerva_bus.outputs import write_output
from minerva_services.views.svg.files import numbered, prepare_folder
from minerva_services.views.window.painter import Pixels


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
