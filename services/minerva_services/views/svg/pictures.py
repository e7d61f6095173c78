"""A series of pictures of one world, all of the same part of it."""

from __future__ import annotations

from minerva_bus.grammar.appearance import Shape
from minerva_bus.grammar.scene import FigureNode, Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.geometry import interpret
from minerva_bus.semantics.plane import Bounds, PlaneGeometry
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
        self._drawn: set[str] = set()
        self._tracer = Tracer()

    def include(self, scene: Scene) -> None:
        """Enlarge the part that pictures show, and their legend, by those of a view."""
        symbols = _DrawnSymbols(self._vocabulary)
        interpret(scene, symbols)
        self._drawn |= symbols.drawn
        self._frame = frame_of(scene, self._vocabulary, self._frame)

    def draw(self, scene: Scene, frame: int) -> str:
        """The SVG document of a view, a string of L(E), in a frame."""
        self._frame = frame_of(scene, self._vocabulary, self._frame)
        page = Page(self._frame, self._width)
        return svg_document(
            scene,
            self._vocabulary,
            page,
            self._tracer,
            self._world,
            f"frame {frame}",
            self._drawn,
        )


class _DrawnSymbols(PlaneGeometry):
    """The symbols of the primitives that a string draws."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        super().__init__(vocabulary)
        self.drawn: set[str] = set()

    def shape(self, shape: Shape, figure: FigureNode) -> None:
        self.drawn.add(figure.symbol)
