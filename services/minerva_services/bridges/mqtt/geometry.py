"""A geometric system of messages: its action for a primitive is a publication."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from minerva_bus.grammar.scene import FigureNode, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.plane import PlaneGeometry
from minerva_services.bridges.mqtt.outbox import Message
from minerva_services.bridges.mqtt.publication import NoTopic, Publication

PLACE = ("x", "y", "angle")


class Messages(PlaneGeometry):
    """Gathers in `said` what topics shall say (eq. 1, in a system of messages).

    α publishes a figure; β adds the transformation's parameters to the names that a topic may be
    made of, and δ takes them away again. `x`, `y` (m) and `angle` (deg) are where the figure is.
    """

    def __init__(
        self,
        vocabulary: Vocabulary,
        publications: Mapping[str, Publication],
        complain: Callable[[str], None],
    ) -> None:
        super().__init__(vocabulary)
        self.said: dict[str, Message] = {}
        self._publications = publications
        self._complain = complain
        self._names: Mapping[str, Any] = {}

    def other_figure(self, figure: FigureNode) -> None:
        """α: a publication."""
        how = self._publications.get(figure.symbol)
        if how is None:
            return
        place = {one: getattr(self.pose, one) for one in PLACE}
        own = figure.parameters
        try:
            topic, message = how.message({**self._names, **place, **own}, own)
        except NoTopic as problem:
            self._complain(f"{figure.symbol}: {problem}")
            return
        self.said[topic] = message

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        """β and δ: more names, and the place."""
        moved = super().other_transformation(transformation)
        return self._named(transformation.parameters, moved)

    @contextmanager
    def _named(
        self, more: Mapping[str, Any], moved: AbstractContextManager[Any]
    ) -> Generator[None]:
        before, self._names = self._names, {**self._names, **more}
        with moved:
            yield
        self._names = before
