"""Bindings of keys and buttons to events, which are created when a world is joined."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from minerva_bus.errors import MisuseError, SceneError
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.parser import parse_value
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.services import WorldInfo
from minerva_services.event_factory import event_type


@dataclass(frozen=True, slots=True)
class Binding:
    """An event type by name, and its data as words; an unnamed word is the only datum."""

    type: str
    words: tuple[tuple[str, str], ...] = ()

    def event(self, service: str, world: WorldInfo, to: tuple[str, ...]) -> Event:
        """The event in a world, for these receivers. Raises MisuseError, naming the service."""
        declared = event_type(service, world, self.type)
        data = {name or only_datum(service, declared): shown for name, shown in self.words}
        # Words with the same name have become one entry.
        if len(data) < len(self.words):
            raise MisuseError(f"{service}: {self} does not fit: each datum is given once")
        kinds = {field.name: field.type.kind for field in declared.fields.all}
        values = {
            # A text may look like a number, so the declared type decides.
            name: shown if kinds.get(name) == "text" else _value(shown)
            for name, shown in data.items()
        }
        try:
            event: Event = declared(receivers=to, **values)
        except (MisuseError, SceneError) as error:
            raise MisuseError(f"{service}: {self} does not fit: {error}") from None
        return event

    def __str__(self) -> str:
        shown = [f"{name}={word}" if name else word for name, word in self.words]
        return " ".join([self.type, *shown])


def only_datum(service: str, declared: EventType, kind: str = "") -> str:
    """Name of an event type's only datum, which must be of a kind. Raises MisuseError."""
    fields = declared.fields.all
    if len(fields) != 1 or kind not in ("", fields[0].type.kind):
        wanted = f"one {kind} number" if kind == "real" else "one datum"
        data = ", ".join(f"{field.name} ({field.type})" for field in fields) or "none"
        raise MisuseError(f"{service}: {declared.name} must have {wanted}; it has {data}")
    return fields[0].name


def bindings(service: str, option: str, given: Mapping[str, Any] | None) -> dict[str, Binding]:
    """Parse an option such as `keys = { w = "eSpeed speed=0.8" }`. Raises MisuseError."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(
            f'{service}: {option} must be a table such as {{ w = "eSpeed speed=0.8" }}'
        )
    return {str(name): _read(service, f"{option}.{name}", text) for name, text in given.items()}


def choices(service: str, type_: str, given: Any) -> list[Binding]:
    """One event per text: a list, or a comma-separated string. Raises MisuseError."""
    if isinstance(given, str):
        given = [text.strip() for text in given.split(",") if text.strip()]
    items = cast("Iterable[Any]", given) if isinstance(given, list | tuple) else (None,)
    texts = [item for item in items if isinstance(item, str) and item]
    if len(texts) < len(list(items)):
        raise MisuseError(
            f'{service}: markers must be a list of strings such as ["kitchen", "lab"]'
        )
    return [Binding(type_, (("", text),)) for text in texts]


def _read(service: str, where: str, text: Any) -> Binding:
    try:
        first, *words = shlex.split(text) if isinstance(text, str) else [""]
    except ValueError:
        first, words = "", list[str]()
    pairs = [word.partition("=") for word in words]
    if not first.startswith("e") or not all(name for name, _, _ in pairs):
        raise MisuseError(
            f"{service}: {where} is {text!r}; expected an event type and its data,"
            " such as 'eSpeed speed=0.8'"
        )
    return Binding(first, tuple([(n, v) if equals else ("", n) for n, equals, v in pairs]))


def _value(shown: str) -> Any:
    """A value in the language's syntax; strings may omit their quotes."""
    try:
        return parse_value(shown, "value")
    except (SceneError, ValueError):
        return shown


@dataclass(frozen=True, slots=True)
class InputRange:
    """A range of numbers from `low` to `high` in steps of `step`."""

    low: float
    high: float
    step: float

    def check(self, service: str) -> None:
        """Raise MisuseError if the range is invalid."""
        if not all(map(math.isfinite, (self.low, self.high, self.step))):
            raise MisuseError(f"{service}: low, high and step must be finite numbers")
        if self.low >= self.high or self.step <= 0:
            raise MisuseError(f"{service}: low must be below high, and step above 0")

    def bounded(self, value: float) -> float:
        """The value, clamped to the range."""
        # Rounding removes the errors of repeated steps, such as 0.1 + 0.2.
        return round(min(max(value, self.low), self.high), 9)

    def nearest(self, value: float) -> float:
        """The nearest multiple of the step within the range."""
        return self.bounded(round(value / self.step) * self.step)


class ControlMap:
    """Bindings by key or button name, and an event type whose only datum is a real number.

    `slide` is the name of that type; empty if there is none.
    """

    def __init__(
        self, service: str, bindings: Mapping[str, Binding], slide: str, to: Sequence[str]
    ) -> None:
        self._service = service
        self._bindings = bindings
        self._slide = slide
        self._to = tuple(sorted(to))
        self._events: dict[str, Event] = {}

    def generates(self) -> tuple[str, ...]:
        """The event types that this device can emit."""
        types = {binding.type for binding in self._bindings.values()} | {self._slide}
        return tuple(sorted(types - {""}))

    def joined(self, world: WorldInfo) -> None:
        """Create the events of a world. Raises MisuseError if they do not fit it."""
        service, to = self._service, self._to
        self._events = {
            name: binding.event(service, world, to) for name, binding in self._bindings.items()
        }
        if self._slide:
            self._sliding = event_type(service, world, self._slide)
            only_datum(service, self._sliding, "real")

    def pressed(self, name: str) -> Event | None:
        """The event of a key or button, if any."""
        return self._events.get(name)

    def slid(self, value: float) -> Event:
        """The event with this number."""
        event: Event = self._sliding(value, receivers=self._to)
        return event

    def descriptions(self) -> list[str]:
        """A line of help per key or button."""
        return [f"{name} {binding}" for name, binding in self._bindings.items()]
