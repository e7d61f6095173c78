"""Messages become events of a world's own types."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, cast

from minerva_bus.errors import MinervaError, MisuseError, VocabularyError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.symbols import EventType
from minerva_bus.grammar.types import Type, Unfit
from minerva_bus.grammar.units import Quantity
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_services.bridges.mqtt.payload import VALUE, Garbage, Payload
from minerva_services.bridges.mqtt.rule import Datum, Rule, filled

_TRUE: Final = ("true", "on", "yes", "1", "open")
_FALSE: Final = ("false", "off", "no", "0", "closed")


class Making:
    """Makes the events of one rule.

    A datum that the rule does not map comes from the topic's level of its name, else from the JSON
    object's field of its name; a payload that is no object is for the one datum that is left.
    """

    def __init__(self, rule: Rule, vocabulary: Vocabulary, declared: EventType) -> None:
        """Raises MisuseError where the rule does not fit the type."""
        self.rule = rule
        self._vocabulary = vocabulary
        self._type = declared
        where = f"mqtt: topics.{rule.pattern.text!r}"
        for name in rule.data:
            if name not in declared.fields.names:
                listed = ", ".join(declared.fields.names) or "none"
                raise MisuseError(f"{where}: {declared.name} has no {name} (it has {listed})")
        for one in declared.fields.all:
            self._check(where, one, rule.data.get(one.name))
        self._check_condition(where)
        self.complained = False
        self._sources = {name: self._source(name) for name in declared.fields.names}
        self._plain = self._only_one_left()

    def __call__(self, topic: str, data: bytes) -> Event | None:
        """The event of a message; None where the rule passes over it. Raises Garbage."""
        levels = self.rule.pattern.levels(topic)
        if levels is None:
            return None
        payload = Payload.of(data)
        values = {
            one.name: self._value(one, levels, payload)
            for one in self._type.fields.all
            if self._given(one, levels, payload)
        }
        if not self._counts({**levels, **payload.fields, **values}):
            return None
        return self._event(levels, values)

    def _counts(self, state: Mapping[str, Any]) -> bool:
        return self.rule.only.holds(state)

    def _event(self, levels: Mapping[str, str], values: Mapping[str, Any]) -> Event:
        quoted = {name: json.dumps(level) for name, level in levels.items()}
        try:
            made = self._type(
                **values,
                receivers=[filled(one, levels) for one in self.rule.receivers],
                condition=filled(self.rule.condition, quoted),
            )
            return self._vocabulary.check_event(cast("Event", made))
        except MinervaError as error:
            raise Garbage(str(error)) from None

    def _check_condition(self, where: str) -> None:
        quoted = dict.fromkeys(self.rule.pattern.names, '""')
        condition = filled(self.rule.condition, quoted)
        try:
            self._vocabulary.check_condition(self._type.name, condition, where)
        except VocabularyError as error:
            raise MisuseError(str(error)) from None

    # --- one datum ---

    def _given(self, one: Field, levels: Mapping[str, str], payload: Payload) -> bool:
        """Whether a datum is there; one that is not has a default. Raises Garbage."""
        if self._found(one, levels, payload) is not None:
            return True
        if one.default is None:
            raise Garbage(f"nothing for {one.name}")
        return False

    def _found(self, one: Field, levels: Mapping[str, str], payload: Payload) -> Any:
        """What a message says for a datum, as it says it; None where it says nothing."""
        source = self._sources[one.name]
        if source[1:-1] in levels and source.startswith("{"):
            return levels[source[1:-1]]
        plain = source == VALUE or one.name == self._plain
        if not plain or isinstance(payload.content, dict):
            return payload.at(source)
        return payload.text if one.type.kind == "text" else payload.content

    def _value(self, one: Field, levels: Mapping[str, str], payload: Payload) -> Any:
        found = self._found(one, levels, payload)
        mapped = self.rule.data.get(one.name, Datum(""))
        try:
            return one.type.fit(_as(one.type, found, mapped))
        except (Unfit, ValueError, OverflowError):
            shown = json.dumps(found, ensure_ascii=False, default=str)[:40]
            raise Garbage(f"{one.name} must be a {one.type}, not {shown}") from None

    def _source(self, name: str) -> str:
        """A path in the payload, or `{level}`."""
        mapped = self.rule.data.get(name, Datum(""))
        return mapped.source or (f"{{{name}}}" if name in self.rule.pattern.names else name)

    def _only_one_left(self) -> str:
        """The datum that a plain payload is for, or none."""
        left = [one for one in self._type.fields.all if self._sources[one.name] == one.name]
        needed = [one for one in left if one.default is None] or left
        return needed[0].name if len(needed) == 1 else ""

    def _check(self, where: str, one: Field, mapped: Datum | None) -> None:
        kind = one.type.kind
        if kind in ("cells", "matrix", "string") and one.default is None:
            raise MisuseError(f"{where}: {one.name} is a {one.type}, which no message says")
        if mapped is None:
            return
        if mapped.unit and Quantity(1.0, mapped.unit).into(one.type.unit) is None:
            raise MisuseError(f"{where}: {one.name} is a {one.type}, not in {mapped.unit}")
        if (mapped.scale, mapped.offset) != (1.0, 0.0) and kind not in ("real", "int"):
            raise MisuseError(
                f"{where}: {one.name} is a {one.type}; scale and offset are not for it"
            )
        if mapped.source.startswith("{") and mapped.source[1:-1] not in self.rule.pattern.names:
            listed = ", ".join(self.rule.pattern.names) or "none"
            raise MisuseError(f"{where} names no level {mapped.source}; its levels: {listed}")


def _as(wanted: Type, found: Any, mapped: Datum) -> Any:
    """What was found, as something that the type may take."""
    if wanted.kind in ("real", "int"):
        return _number(wanted, found, mapped)
    if wanted.kind == "bool":
        word = str(found).strip().lower()
        return word in _TRUE if word in _TRUE + _FALSE else found
    return found


def _number(wanted: Type, found: Any, mapped: Datum) -> Any:
    if isinstance(found, bool) or not isinstance(found, int | float | str):
        return found
    if (mapped.scale, mapped.offset, mapped.unit) == (1.0, 0.0, "") and isinstance(found, int):
        return found  # as it is, to the last digit
    number = float(found) * mapped.scale + mapped.offset
    return Quantity(number, mapped.unit) if mapped.unit else number
