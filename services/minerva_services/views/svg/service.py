"""The picture device: a world's views as SVG files, optionally also as PNG."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from minerva_bus.errors import MisuseError
from minerva_bus.files import check_ending, check_output, text_of_path, write_output
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.wording import install
from minerva_bus.world.services import Device, View, WorldInfo
from minerva_services.options import event_types
from minerva_services.views.svg.files import numbered, prepare_folder
from minerva_services.views.svg.pictures import Pictures

_WIDTHS = range(100, 10_001)


class Svg(Device, draws=("ePicture",)):
    """Draws every world whose vocabulary declares forms, one picture every few frames.

    Args:
        path: the output file; its folder is created if missing. Each picture replaces the previous
          one atomically.
        every: frames between pictures; 0 leaves requesting them to a generator.
        frames: keep all pictures, numbered by frame, as in `minerva-000010.svg`.
        png: also write a PNG; needs `pip install 'minerva-bus[picture]'`.
        width: width in pixels; the height follows from the world.
        draws: visual event types, comma-separated; their views are drawn over each other in this
          order.

    """

    def __init__(
        self,
        path: str = "minerva.svg",
        every: int = 10,
        frames: bool = False,
        png: bool = True,
        width: int = 1200,
        draws: str = "ePicture",
    ) -> None:
        if every < 0:
            raise MisuseError(f"picture: every is {every}; expected a number of frames from 0")
        if width not in _WIDTHS:
            raise MisuseError(f"picture: width is {width}; expected 100 to 10000 pixels")
        self.when = f"each {every} frames" if every else ""
        self.draws = event_types("picture", draws)
        self._path = Path(path)
        check_ending(self._path, (".svg",), "picture")
        self.writes = (self._path, self._path.with_suffix(".png")) if png else (self._path,)
        self._keeps_all = frames
        self._makes_png = png
        self._width = width
        self._pictures: Pictures | None = None
        self._views: dict[str, View] = {}
        self._written: Path | None = None
        self._check_outputs()

    @staticmethod
    def pictures(world: str, vocabulary: Vocabulary, width: int) -> Pictures:
        """Pictures without files, as a notebook shows them."""
        return Pictures(world, vocabulary, width)

    @staticmethod
    def png(document: str) -> bytes:
        """An SVG document as a PNG. Raises MisuseError, also without the extra `picture`."""
        try:
            from minerva_services.views.svg.rendering import png
        except ImportError:
            raise MisuseError(f"a picture as PNG: {install('picture')}") from None
        return png(document)

    def _check_outputs(self) -> None:
        """Reject output files that must not be overwritten before the world runs."""
        if self._keeps_all:
            return  # file names depend on the frame
        for path in self.writes:
            check_output(path, "picture")

    def joined(self, world: WorldInfo) -> None:
        self._pictures = self.pictures(world.world, world.vocabulary, self._width)
        prepare_folder(self._path)

    def show(self, view: View) -> None:
        self._views[view.event_type] = view
        if any(self._frame_of(event_type) != view.frame for event_type in self.draws):
            return  # A picture shows one frame.
        document = self._draw(view.frame)
        path = numbered(self._path, view.frame) if self._keeps_all else self._path
        write_output(path, document.encode(), "picture")
        self._written = path
        if self._makes_png:
            self._write_png(path.with_suffix(".png"), document)

    def report(self) -> Mapping[str, bool | int | float | str]:
        if self._written is None:
            return {}
        figures = {"picture": text_of_path(self._written)}
        if self._written.suffix == ".png":
            figures["picture_as_svg"] = text_of_path(self._written.with_suffix(self._path.suffix))
        return figures

    def _draw(self, frame: int) -> str:
        if self._pictures is None:
            raise MisuseError("picture: a view arrived before the world was joined")
        nodes = [node for event_type in self.draws for node in self._views[event_type].scene]
        return self._pictures.draw(Scene(tuple(nodes)), frame)

    def _frame_of(self, event_type: str) -> int:
        view = self._views.get(event_type)
        return -1 if view is None else view.frame

    def _write_png(self, path: Path, document: str) -> None:
        try:
            from minerva_services.views.svg.rendering import png
        except ImportError:
            # Reported once; further pictures are SVG only.
            self._makes_png = False
            sys.stderr.write(f"picture: no PNG, only SVG; {install('picture')}\n")
            return
        write_output(path, png(document), "picture")
        self._written = path
