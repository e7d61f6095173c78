"""A geometric system of messages: its action for a primitive is a publication."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from minerva_bus.grammar.scene import FigureNode, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.plane import PlaneGeometry
from minerva_services.bridges.mqtt.outbox import MqttMessage
from minerva_services.bridges.mqtt.publication import NoTopic, Publication

PLACE = ("x", "y", "angle")


class MessageGeometry(PlaneGeometry):
    """Collects in `messages` what topics should contain (eq. 1, in a system of messages).

    α publishes a figure; β adds a transformation's parameters to the names that a topic may use,
    and δ removes them. `x`, `y` (m) and `angle` (deg) give the figure's pose.
    """

    def __init__(
        self,
        vocabulary: Vocabulary,
        publications: Mapping[str, Publication],
        report: Callable[[str], None],
    ) -> None:
        super().__init__(vocabulary)
        self.messages: dict[str, MqttMessage] = {}
        self._publications = publications
        self._report = report
        self._names: Mapping[str, Any] = {}

    def other_figure(self, figure: FigureNode) -> None:
        """α: a publication."""
        how = self._publications.get(figure.symbol)
        if how is None:
            return
        place = {name: getattr(self.pose, name) for name in PLACE}
        own = figure.parameters
        try:
            topic, message = how.message({**self._names, **place, **own}, own)
        except NoTopic as problem:
            self._report(f"{figure.symbol}: {problem}")
            return
        self.messages[topic] = message

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        """β and δ: scope of names, and the pose."""
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
