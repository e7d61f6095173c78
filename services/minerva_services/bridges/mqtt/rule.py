"""Rules that turn messages into events: configuration in a world file, parsed and checked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, cast

from minerva_bus.errors import MisuseError, VocabularyError, nearest
from minerva_bus.grammar.condition import Condition, parse_condition
from minerva_services.bridges.mqtt.pattern import Pattern

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
