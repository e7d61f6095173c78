"""Conversion of messages, JSON or plain text and numbers, to events of a world's own types."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, cast

from minerva_bus.errors import MinervaError, MisuseError, VocabularyError
from minerva_bus.grammar.condition import ANYTHING, Scope, sort_of_kind, value_sort
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.measures import Quantity
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.types import Type, Unfit
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_services.bridges.mqtt.rule import Datum, TopicRule, filled

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
        for field in declared.fields.all:
            self._check(where, field, rule.data.get(field.name))
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
