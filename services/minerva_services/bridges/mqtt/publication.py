"""Publications of figures: configuration in a world file, and the geometry that makes them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.scene import FigureNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.plane import PlaneGeometry
from minerva_services.bridges.mqtt.outbox import MqttMessage
from minerva_services.bridges.mqtt.rule import checked_qos

_PUBLISH_KEYS: Final = ("topic", "payload", "retain", "qos", "gone")
_NAME = re.compile(r"\{(\w+)\}")
# Maximum length of a topic (MQTT 3.1.1, 1.5.3).
_MAX_BYTES = 65535


class Unpublished(Exception):
    """A topic or a payload cannot be derived from a figure."""


@dataclass(frozen=True, slots=True)
class Publication:
    """How figures of one symbol are published.

    `{name}` in topic and payload is a parameter of the figure or of a surrounding transformation.
    Without a payload template, the payload is a JSON object of the figure's parameters.
    """

    topic: str
    payload: str = ""
    retain: bool = False
    qos: int = 0
    gone: str | None = None

    def message(self, names: Mapping[str, Any], own: Mapping[str, Any]) -> tuple[str, MqttMessage]:
        """Topic and message of a figure, from names in scope and its own. Raises Unpublished."""
        topic = _NAME.sub(lambda match: _level(match[1], names), self.topic)
        if not topic or len(topic.encode()) > _MAX_BYTES:
            raise Unpublished(f"{topic[:40]!r} is not a topic")
        if self.payload:
            text = _NAME.sub(lambda match: _filled(match[1], names), self.payload)
        else:
            text = json.dumps(dict(own), default=_plain, ensure_ascii=False)
        gone = None if self.gone is None else self.gone.encode()
        return topic, MqttMessage(text.encode(), self.qos, self.retain, gone)

    def names(self) -> set[str]:
        """The names that it uses."""
        return set(_NAME.findall(self.topic + self.payload))


def publications_of(given: Mapping[str, Any], qos: int) -> Mapping[str, Publication]:
    """Publications by primitive: a topic, or a table. Raises MisuseError."""
    return {symbol: _publication(symbol, options, qos) for symbol, options in given.items()}


def _publication(symbol: str, given: Any, qos: int) -> Publication:
    where = f"mqtt: publish.{symbol}"
    raw = {"topic": given} if isinstance(given, str) else given
    if not isinstance(raw, Mapping):
        raise MisuseError(f"{where} must be a topic, or a table with one")
    table = cast("Mapping[str, Any]", raw)
    for key in table:
        if key not in _PUBLISH_KEYS:
            near = nearest(key, list(_PUBLISH_KEYS))
            raise MisuseError(f"{where} has no {key!r}{near}; it may have {', '.join(_PUBLISH_KEYS)}")
    for key in ("topic", "payload", "gone"):
        if not isinstance(table.get(key, ""), str):
            raise MisuseError(f"{where}: {key} must be a string")
    topic, retain = table.get("topic", ""), table.get("retain", False)
    if not topic or set(topic) & set("+#\0"):
        raise MisuseError(f"{where}: topic is {topic!r}; expected one without + and #")
    if not isinstance(retain, bool):
        raise MisuseError(f"{where}: retain must be true or false")
    checked = checked_qos(where, table.get("qos", qos))
    return Publication(topic, table.get("payload", ""), retain, checked, table.get("gone"))


def _level(name: str, names: Mapping[str, Any]) -> str:
    level = _filled(name, names)
    # A broker may close the connection of a client that publishes to a topic with wildcards.
    if not level or set(level) & set("+#\0"):
        raise Unpublished(f"{name} is {level[:40]!r}, which cannot stand in a topic")
    return level


def _filled(name: str, names: Mapping[str, Any]) -> str:
    # A transformation with this parameter exists, but not around every figure.
    if name not in names:
        raise Unpublished(f"no transformation around it has {name}")
    return _word(names[name])


def _word(value: Any) -> str:
    """A value as devices expect it: ON and OFF, plain numbers and strings."""
    if isinstance(value, bool):
        return "ON" if value else "OFF"
    return value if isinstance(value, str) else json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return cast("Any", value).tolist()
    return str(value) if isinstance(value, Scene) else list(value)


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
            # The innermost name counts: the figure's own parameters hide those around it.
            topic, message = how.message({**self._names, **place, **own}, own)
        except Unpublished as problem:
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
