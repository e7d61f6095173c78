"""A series of pictures of one world, all of the same part of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.plane import Bounds
from minerva_services.geometry.colors import DrawnColors
from minerva_services.views.svg.document import Page, Tracer, frame_of, svg_document


class Pictures:
    """Draws views of a world as SVG documents.

    Args:
        world: its name, for the caption.
        vocabulary: with the forms of its primitives.
        width: in pixels; the height follows from the world.

    The part that they show and their legend only grow, so that a series does not jump.

    """

    def __init__(self, world: str, vocabulary: Vocabulary, width: int) -> None:
        self._world = world
        self._vocabulary = vocabulary
        self._width = width
        self._frame: Bounds | None = None
        self._drawn = DrawnColors()
        self._tracer = Tracer()

    def film(self, views: Sequence[tuple[int, Scene]]) -> Iterator[str]:
        """The documents of views with the numbers of their frames.

        All show the same part of the world, and the same legend.
        """
        for _, scene in views:
            self._include(scene)
        for frame, scene in views:
            yield self.draw(scene, frame)

    def _include(self, scene: Scene) -> Bounds:
        """Enlarge the part that pictures show, and their legend, by those of a view."""
        self._frame = frame_of(scene, self._vocabulary, self._frame, self._drawn)
        return self._frame

    def draw(self, scene: Scene, frame: int) -> str:
        """The SVG document of a view, a string of L(E), in a frame."""
        page = Page(self._include(scene), self._width)
        return svg_document(
            scene,
            self._vocabulary,
            page,
            self._tracer,
            self._world,
            f"frame {frame}",
            self._drawn.legend(self._vocabulary),
        )
