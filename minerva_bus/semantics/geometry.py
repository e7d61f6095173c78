"""Geometric systems G and the function φ that interprets a string in one (equation 1)."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, Self, cast

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Columns, walk_pieces
from minerva_bus.grammar.scene import (
    AgentNode,
    FigureNode,
    Scene,
    TransformationNode,
    checked_string,
)


class Geometry:
    """A geometric system G: its actions for a primitive (α), at "(" (β) and at ")" (δ).

    A subclass has a method for each symbol that has a meaning in it, with the name of the symbol
    and its parameters as arguments. The method of a transformation is a context manager: β before
    `yield`, δ after it.

        class Turtle(Geometry):
            def PStar(self, size): ...

            @contextmanager
            def TMove(self, dist):
                self.x += dist
                yield
                self.x -= dist

    A symbol without a method is passed to `other_figure` or `other_transformation`, which do
    nothing: in this system it has no meaning.
    """

    _open: list[AbstractContextManager[Any]]

    def __new__(cls, *_args: Any, **_kwargs: Any) -> Self:
        """Set up the stack here, because subclasses need not call the base constructor."""
        geometry = super().__new__(cls)
        geometry._open = []
        return geometry

    def draw(self, figure: FigureNode) -> None:
        """α : P → G."""
        method = getattr(self, figure.symbol, None)
        if method is None:
            self.other_figure(figure)
        else:
            method(**figure.parameters)

    def enter(self, transformation: TransformationNode) -> None:
        """β : T → G, at the symbol "("."""
        method = getattr(self, transformation.symbol, None)
        if method is None:
            scope = self.other_transformation(transformation)
        else:
            scope = method(**transformation.parameters)
        # A method without the decorator returns a generator, whose code would never run.
        if not isinstance(scope, AbstractContextManager):
            raise MisuseError(
                f"{type(self).__name__}.{transformation.symbol} must be a context manager"
                " (@contextmanager: β before `yield`, δ after it)"
            )
        opened = cast("AbstractContextManager[Any]", scope)
        opened.__enter__()
        # After β has run: a transformation whose β fails needs no δ.
        self._open.append(opened)

    def leave(self, transformation: TransformationNode) -> None:
        """δ : T → G, at the symbol ")"."""
        self._open.pop().__exit__(None, None, None)

    def many(self, columns: Columns) -> bool:
        """Interpret nodes of one shape at once; False passes them to the system one by one.

        `columns` has a row per node: arrays of parameters, and in `scope` the contents of each.
        """
        return False

    def other_figure(self, figure: FigureNode) -> None:
        """α of a primitive that has no method here."""

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        """β and δ of a transformation that has no method here."""
        return _NOTHING


class _Nothing(AbstractContextManager[None]):
    def __exit__(self, *exc: object) -> None:
        return None


_NOTHING = _Nothing()


def interpret(scene: Scene, geometry: Geometry) -> None:
    """φ : L(E) → G, equation 1: run a string of primitives and transformations.

    After an error, δ still runs for each β that has run.

    Args:
        scene: a string of L(E), such as a view.
        geometry: the geometric system, whose methods run for each symbol.

    Raises:
        MisuseError: the string contains an agent, because φ is defined for L(E) only; an argument
            is of a wrong type.

    """
    checked_string(scene)
    if not isinstance(geometry, Geometry):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"geometry must be a Geometry, not {geometry!r:.60}")
    opened: list[TransformationNode] = []
    try:
        for opens, node in walk_pieces(scene, geometry.many):
            if isinstance(node, FigureNode):
                geometry.draw(node)
            elif isinstance(node, AgentNode):
                raise MisuseError(f"φ is for strings without agents, not {node.symbol}#{node.id}")
            elif opens:
                geometry.enter(node)
                opened.append(node)
            else:
                geometry.leave(opened.pop())
    finally:
        # Otherwise a geometry that is used again would begin in a moved pose.
        while opened:
            geometry.leave(opened.pop())
