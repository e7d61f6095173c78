"""Rules of a world file: which messages become events, and which figures become messages.

A message is JSON, or plain text or a number; its event is of a type of the world. Publications are
made by a geometry, from the figures of a view.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Any, Final, cast

import numpy as np

from minerva_bus.errors import MinervaError, MisuseError, VocabularyError, nearest
from minerva_bus.grammar.condition import (
    ANYTHING,
    Condition,
    Scope,
    parse_condition,
    sort_of_kind,
    value_sort,
)
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.scene import FigureNode, Scene, TransformationNode
from minerva_bus.grammar.types import Quantity, Type, Unfit
from minerva_bus.grammar.vocabulary import EventType, Vocabulary
from minerva_bus.semantics.plane import PlaneGeometry
from minerva_services.bridges.mqtt.connection import MqttMessage

_NAMED = re.compile(r"\{([A-Za-z_][A-Za-z0-9_]*)\}")


@dataclass(frozen=True, slots=True)
class Pattern:
    """A pattern such as `home/{room}/temperature`, `home/+/#`.

    `{room}` matches one level like `+` and names it; each `+` is named by its position, from 1.
    `filter` is the subscription sent to the broker (MQTT 3.1.1, 4.7).
    """

    text: str
    filter: str
    names: tuple[str, ...]
    _matches: re.Pattern[str]

    @staticmethod
    def of(text: str) -> Pattern:
        """Parse a pattern. Raises MisuseError."""
        names: list[str] = []
        levels: list[str] = []
        parts: list[str] = []
        unnamed = 0
        for level in _levels(text):
            named = _NAMED.fullmatch(level)
            if named or level == "+":
                unnamed += named is None
                names.append(named[1] if named else str(unnamed))
                levels.append("+")
                parts.append("([^/]*)")
            else:
                levels.append(level)
                parts.append(re.escape(level) if level != "#" else ".*")
        if len(set(names)) != len(names):
            raise _wrong(text, "a name for one level only")
        expression = "/".join(parts)
        if levels[-1] == "#":
            # `a/#` also matches `a` itself (MQTT 3.1.1, 4.7.1.2).
            expression = expression.removesuffix("/.*") + "(?:/.*)?" if len(levels) > 1 else ".*"
        # DOTALL, because topics may contain line breaks.
        return Pattern(text, "/".join(levels), tuple(names), re.compile(expression, re.DOTALL))

    def levels(self, topic: str) -> Mapping[str, str] | None:
        """The named levels of a topic; None if it does not match."""
        match = self._matches.fullmatch(topic)
        if match is None:
            return None
        return dict(zip(self.names, match.groups(), strict=True))


def _levels(text: str) -> list[str]:
    if not text or "\0" in text or len(text.encode()) > 65535:
        raise _wrong(text, "up to 65535 bytes of text")
    levels = text.split("/")
    if "#" in levels[:-1]:
        raise _wrong(text, "# as the last level only")
    for level in levels:
        if level not in ("+", "#") and not _NAMED.fullmatch(level) and set(level) & set("+#{}"):
            raise _wrong(text, "+, # and {name} as whole levels")
    return levels


def _wrong(text: str, expected: str) -> MisuseError:
    return MisuseError(f"mqtt: topic {text[:80]!r}; expected {expected}")


_KEYS: Final = ("event", "data", "if", "receivers", "condition", "retained", "qos")
_DATUM_KEYS: Final = ("from", "scale", "offset", "unit")
_LEVEL = re.compile(r"\{(\w+)\}")


@dataclass(frozen=True, slots=True)
class Datum:
    """Source of an event's datum: value · scale + offset, in a unit."""

    source: str
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""


@dataclass(frozen=True, slots=True)
class TopicRule:
    """Messages on a topic that become events of a type."""

    pattern: Pattern
    event: str
    data: Mapping[str, Datum] = field(default_factory=dict[str, Datum])
    only: Condition = field(default_factory=lambda: Condition(""))
    receivers: tuple[str, ...] = ()
    condition: str = ""
    retained: bool = True
    qos: int = 0


def rules_of(topics: Mapping[str, Any], qos: int) -> tuple[TopicRule, ...]:
    """The rules by topic pattern: an event type, a table, or a list of these.

    Raises MisuseError.
    """
    rules: list[TopicRule] = []
    for text, given in topics.items():
        pattern = Pattern.of(text)
        several = cast("list[Any]", given) if isinstance(given, list) else [given]
        rules += [_rule(pattern, entry, qos) for entry in several]
    return tuple(rules)


def filled(template: str, names: Mapping[str, str]) -> str:
    """The template with each `{name}` replaced."""
    return _LEVEL.sub(lambda match: names[match[1]], template)


def _rule(pattern: Pattern, given: Any, qos: int) -> TopicRule:
    raw = {"event": given} if isinstance(given, str) else given
    where = f"mqtt: topics.{pattern.text!r}"
    if not isinstance(raw, Mapping):
        raise MisuseError(f"{where} must be an event type, or a table with one")
    table = cast("Mapping[str, Any]", raw)
    _check_keys(where, table, _KEYS)
    retained, own = table.get("retained", True), table.get("qos", qos)
    if not isinstance(retained, bool):
        raise MisuseError(f"{where}: retained must be true or false")
    return TopicRule(
        pattern,
        _text(where, table, "event", needed=True),
        {name: _datum(f"{where}: {name}", datum) for name, datum in _table(where, table)},
        _only(where, _text(where, table, "if")),
        tuple(_templates(where, pattern, _receivers(where, table))),
        _condition(where, pattern, _text(where, table, "condition")),
        retained,
        checked_qos(where, own),
    )


def checked_qos(where: str, qos: Any) -> int:
    """Validate a QoS: 0, 1 or 2. Raises MisuseError."""
    # A bool is an int: `True in (0, 1, 2)` holds.
    if isinstance(qos, bool) or qos not in (0, 1, 2):
        raise MisuseError(f"{where}: qos is {qos!r}; expected 0, 1 or 2")
    return int(qos)


def _check_keys(where: str, table: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            near = nearest(key, list(known))
            raise MisuseError(f"{where} has no {key!r}{near}; it may have {', '.join(known)}")


def _text(where: str, table: Mapping[str, Any], key: str, *, needed: bool = False) -> str:
    value = table.get(key, "")
    if not isinstance(value, str) or (needed and not value):
        raise MisuseError(f"{where}: {key} must be a string")
    return value


def _table(where: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    table_ = table.get("data", {})
    if not isinstance(table_, Mapping):
        raise MisuseError(f"{where}: data must be a table: datum = where it comes from")
    yield from cast("Mapping[str, Any]", table_).items()


def _datum(where: str, given: Any) -> Datum:
    if isinstance(given, str) and given:
        return Datum(given)
    if not isinstance(given, Mapping):
        raise MisuseError(f"{where} must be a string or a table, as {{ from = 'celsius' }}")
    table = cast("Mapping[str, Any]", given)
    _check_keys(where, table, _DATUM_KEYS)
    numbers = table.get("scale", 1.0), table.get("offset", 0.0)
    if not all(
        isinstance(number, int | float) and not isinstance(number, bool) for number in numbers
    ):
        raise MisuseError(f"{where}: scale and offset must be numbers")
    scale, offset = map(float, numbers)
    return Datum(_text(where, table, "from"), scale, offset, _text(where, table, "unit"))


def _only(where: str, text: str) -> Condition:
    try:
        return parse_condition(text, f"{where}: if")
    except VocabularyError as error:
        raise MisuseError(str(error)) from None


def _receivers(where: str, table: Mapping[str, Any]) -> list[str]:
    value = table.get("receivers", [])
    ids: list[Any] = [value] if isinstance(value, str) else value
    if not isinstance(ids, list) or not all(isinstance(id, str) for id in ids):
        raise MisuseError(f"{where}: receivers must be a list of ids, as ['{{room}}']")
    return ids


def _templates(where: str, pattern: Pattern, templates: list[str]) -> Iterator[str]:
    for template in templates:
        for name in _LEVEL.findall(template):
            if name not in pattern.names:
                names = ", ".join(pattern.names) or "none"
                raise MisuseError(f"{where} has no level {name!r}; its levels: {names}")
        yield template


def _condition(where: str, pattern: Pattern, text: str) -> str:
    """The condition template of the events; `{room}` stands for the level as a quoted string."""
    (template,) = _templates(where, pattern, [text])
    try:
        parse_condition(filled(template, dict.fromkeys(pattern.names, '""')), where)
    except VocabularyError as error:
        raise MisuseError(str(error)) from None
    return template


MAX_BYTES: Final = 64 * 1024
WHOLE_PAYLOAD: Final = "value"
"""Name of a payload that is not a JSON object."""


class InvalidPayload(Exception):
    """A message cannot become an event; the text gives the reason."""


Note = Callable[[str, str], None]
"""Receives the metric under which something about a message counts, and the reason."""


@dataclass(frozen=True, slots=True)
class Payload:
    """A payload as text and as parsed JSON; text that is not JSON stands for itself."""

    text: str
    content: Any

    @staticmethod
    def of(data: bytes) -> Payload:
        """Decode a payload. Raises InvalidPayload."""
        if len(data) > MAX_BYTES:
            raise InvalidPayload(f"{len(data)} bytes, the limit is {MAX_BYTES}")
        try:
            text = data.decode()
        except UnicodeDecodeError:
            raise InvalidPayload("not UTF-8 text") from None
        try:
            return Payload(text, json.loads(text))
        # A few kilobytes of nested lists exhaust the stack of the decoder.
        except (ValueError, RecursionError):
            return Payload(text, text)

    @property
    def fields(self) -> Mapping[str, Any]:
        """The fields of a JSON object; otherwise the payload itself as `value`."""
        if isinstance(self.content, dict):
            return cast("dict[str, Any]", self.content)
        return {WHOLE_PAYLOAD: self.content}

    def at(self, path: str) -> Any:
        """The value at a path such as `sensors.0.celsius`; None if absent."""
        value: Any = self.fields
        for step in path.split("."):
            if isinstance(value, Mapping):
                value = cast("Mapping[str, Any]", value).get(step)
            elif isinstance(value, list) and step.isdecimal():
                items = cast("list[Any]", value)
                value = items[int(step)] if int(step) < len(items) else None
            else:
                return None
        return value


_TRUE: Final = ("true", "on", "yes", "1", "open")
_FALSE: Final = ("false", "off", "no", "0", "closed")


class EventRule:
    """Creates the events of one rule.

    A datum that the rule does not map comes from the topic level of its name, otherwise from the
    JSON field of its name; a payload that is not an object fills the only remaining datum.
    """

    def __init__(self, rule: TopicRule, vocabulary: Vocabulary, declared: EventType) -> None:
        """Raises MisuseError if the rule does not fit the type."""
        self.rule = rule
        self._vocabulary = vocabulary
        self._type = declared
        where = f"mqtt: topics.{rule.pattern.text!r}"
        for name in rule.data:
            if name not in declared.fields.names:
                names = ", ".join(declared.fields.names) or "none"
                raise MisuseError(f"{where}: {declared.name} has no {name} (it has {names})")
        for each in declared.fields.all:
            self._check(where, each, rule.data.get(each.name))
        self._check_condition(where)
        self._check_only(where)
        self.reported = set[str]()
        """The metrics of which the first message has been logged."""
        defaults = {field.name: field.default for field in declared.fields.all}
        self._defaults = {name: value for name, value in defaults.items() if value is not None}
        self._sources = {name: self._source(name) for name in declared.fields.names}
        self._plain = self._only_one_left()

    def __call__(self, topic: str, data: bytes, note: Note) -> Event | None:
        """The event of a message; None if the rule skips it. Raises InvalidPayload."""
        levels = self.rule.pattern.levels(topic)
        if levels is None:
            return None
        payload = Payload.of(data)
        values = {
            field.name: self._value(field, levels, payload)
            for field in self._type.fields.all
            if self._has_value(field, levels, payload)
        }
        if not self._counts(levels, payload, values, note):
            return None
        for name, mapped in self.rule.data.items():
            if mapped.source and name not in values:
                note("defaults", f"no {mapped.source}, so {name} has its default")
        return self._event(levels, values)

    def _counts(
        self,
        levels: Mapping[str, str],
        payload: Payload,
        values: Mapping[str, Any],
        note: Note,
    ) -> bool:
        """Whether a message fulfils `if`; one that lacks a name in it is noted."""
        only = self.rule.only
        nested = {name: payload.at(name) for name in only.names if "." in name}
        # Converted values, and the defaults of missing ones, hide the raw ones of the same names.
        state = {**levels, **payload.fields, **nested, **self._defaults, **values}
        problem = only.problem(lambda name: value_sort(state.get(name)))
        if problem is not None:
            _, name, other = problem
            reason = f"{name} is not {other}" if other else f"no {name} to compare"
            note("passed over", f"if: {reason}")
        return only.holds(state)

    def _event(self, levels: Mapping[str, str], values: Mapping[str, Any]) -> Event:
        # Quoted, so that a topic level cannot add operators to the condition.
        quoted = {name: json.dumps(level) for name, level in levels.items()}
        try:
            event = self._type(
                **values,
                receivers=[filled(template, levels) for template in self.rule.receivers],
                condition=filled(self.rule.condition, quoted),
            )
            return self._vocabulary.check_event(cast("Event", event))
        except MinervaError as error:
            raise InvalidPayload(str(error)) from None

    def _check_condition(self, where: str) -> None:
        quoted = dict.fromkeys(self.rule.pattern.names, '""')
        condition = filled(self.rule.condition, quoted)
        try:
            self._vocabulary.check_condition(self._type.name, condition, where)
        except VocabularyError as error:
            raise MisuseError(str(error)) from None

    def _check_only(self, where: str) -> None:
        """Raise MisuseError if no message can fulfil `if`; fields of JSON may have any name."""
        data = {field.name: sort_of_kind(field.type.kind) for field in self._type.fields.all}

        def sort_of(name: str) -> str:
            # Only conditions of norms can name an agent.
            return data.get(name, "" if name.startswith("#") else ANYTHING)

        try:
            scope = Scope(f"a message for {self._type.name}", [*data], sort_of)
            self.rule.only.check([scope], f"{where}: if")
        except VocabularyError as error:
            raise MisuseError(str(error)) from None

    # --- one datum ---

    def _has_value(self, field: Field, levels: Mapping[str, str], payload: Payload) -> bool:
        """True if a message has the datum; a missing one needs a default. Raises InvalidPayload."""
        if self._raw(field, levels, payload) is not None:
            return True
        if field.default is None:
            raise InvalidPayload(f"no value for {field.name}")
        return False

    def _raw(self, field: Field, levels: Mapping[str, str], payload: Payload) -> Any:
        """The unconverted value of a datum in a message; None if absent."""
        source = self._sources[field.name]
        if source[1:-1] in levels and source.startswith("{"):
            return levels[source[1:-1]]
        plain = source == WHOLE_PAYLOAD or field.name == self._plain
        if not plain or isinstance(payload.content, dict):
            return payload.at(source)
        # Text that looks like JSON, such as 12, remains text for a datum of that type.
        return payload.text if field.type.kind == "text" else payload.content

    def _value(self, field: Field, levels: Mapping[str, str], payload: Payload) -> Any:
        raw = self._raw(field, levels, payload)
        mapped = self.rule.data.get(field.name, Datum(""))
        try:
            return field.type.fit(_as(field.type, raw, mapped))
        except (Unfit, ValueError, OverflowError):
            shown = json.dumps(raw, ensure_ascii=False, default=str)[:40]
            raise InvalidPayload(f"{field.name} must be a {field.type}, not {shown}") from None

    def _source(self, name: str) -> str:
        """A path in the payload, or `{level}`."""
        mapped = self.rule.data.get(name, Datum(""))
        return mapped.source or (f"{{{name}}}" if name in self.rule.pattern.names else name)

    def _only_one_left(self) -> str:
        """Name of the datum that a plain payload fills, or ""."""
        left = [field for field in self._type.fields.all if self._sources[field.name] == field.name]
        needed = [field for field in left if field.default is None] or left
        return needed[0].name if len(needed) == 1 else ""

    def _check(self, where: str, field: Field, mapped: Datum | None) -> None:
        kind = field.type.kind
        if kind in ("cells", "matrix", "string") and field.default is None:
            raise MisuseError(
                f"{where}: {field.name} is a {field.type}, which messages cannot carry"
            )
        if mapped is None:
            return
        if mapped.unit and Quantity(1.0, mapped.unit).into(field.type.unit) is None:
            raise MisuseError(f"{where}: {field.name} is a {field.type}, not in {mapped.unit}")
        if (mapped.scale, mapped.offset) != (1.0, 0.0) and kind not in ("real", "int"):
            raise MisuseError(
                f"{where}: {field.name} is a {field.type}, which has no scale and offset"
            )
        if mapped.source.startswith("{") and mapped.source[1:-1] not in self.rule.pattern.names:
            names = ", ".join(self.rule.pattern.names) or "none"
            raise MisuseError(f"{where} has no level {mapped.source}; its levels: {names}")


def _as(wanted: Type, raw: Any, mapped: Datum) -> Any:
    """A raw value, converted to something that the type may accept."""
    if wanted.kind in ("real", "int"):
        return _number(wanted, raw, mapped)
    if wanted.kind == "bool":
        word = str(raw).strip().lower()
        return word in _TRUE if word in _TRUE + _FALSE else raw
    return raw


def _number(wanted: Type, raw: Any, mapped: Datum) -> Any:
    # A truth value of JSON is not a number, although a bool of Python is.
    if isinstance(raw, bool) or not isinstance(raw, int | float | str):
        return raw
    if (mapped.scale, mapped.offset, mapped.unit) == (1.0, 0.0, "") and isinstance(raw, int):
        return raw  # unchanged: a float would lose digits
    number = float(raw) * mapped.scale + mapped.offset
    return Quantity(number, mapped.unit) if mapped.unit else number


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
            raise MisuseError(
                f"{where} has no {key!r}{near}; it may have {', '.join(_PUBLISH_KEYS)}"
            )
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
