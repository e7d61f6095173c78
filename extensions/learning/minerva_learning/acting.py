"""Actions: events that a policy sends to the agents it controls, and their spaces.

| action                              | space                                                    |
|-------------------------------------|----------------------------------------------------------|
| an event type whose data are reals  | `Box` of float64, a number for each datum                |
| ... words, bools, ints with a range | `Discrete`; `MultiDiscrete` for several                  |
| ... others                          | `Dict` by the names of data                              |
| an event type without data          | `Discrete(2)`: 1 sends the event                         |
| a list of events and None           | `Discrete(n)`: the number of the event to send           |

Numbers are of float64, because a float32 may lie outside of a range of the vocabulary.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final, TypeAlias, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.fields import Field
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.types import Type
from minerva_bus.grammar.vocabulary import AgentKind, EventType

Act: TypeAlias = "str | EventType | Event | Sequence[Event | None]"
"""What agents do: an event type (its data are the action), or a list of events to choose from."""

AnySpace: TypeAlias = "spaces.Space[Any]"
Rows: TypeAlias = "Sequence[Any] | NDArray[Any]"
"""An action for each of several agents."""

MAX_CHOICES: Final = 10_000
"""Longest range of a whole number that is a `Discrete` space."""


class Acting:
    """Converts actions to events; `space` is the action space."""

    space: AnySpace

    def event(self, agent: str, action: Any) -> Event | None:
        """The event of an action for an agent; None: none. Raises MisuseError."""
        raise NotImplementedError

    def events(self, agents: Ids, actions: Rows) -> list[AnyEvent]:
        """The events of actions, a row for each agent, in batches. Raises MisuseError.

        A world accepts a batch in one call, and does not keep the fates of its events.
        """
        by_type: dict[str, list[Event]] = {}
        for agent, action in zip(agents, actions, strict=True):
            event = self.event(agent, action)
            if event is not None:
                by_type.setdefault(event.type, []).append(event)
        # The world orders events by their types, so only the order within a type matters.
        sent: list[AnyEvent] = []
        for events in by_type.values():
            # One event takes less as it is, and some do not fit into columns.
            batch = Events.of(events) if len(events) > 1 else None
            sent += events if batch is None else [batch]
        return sent


def acting_of(
    act: Act,
    kind: AgentKind,
    known: Mapping[str, EventType],
    refusal: Callable[[str], str] = lambda _: "",
) -> Acting:
    """The actions of a kind of agents; `known` are event types by name.

    Raises MisuseError for events that do not concern the kind, or for which there is a `refusal`.
    """

    def check(name: str) -> None:
        if name not in known:
            raise MisuseError(f"act: the world has no event type {name}{nearest(name, [*known])}")
        if name not in kind.subscribes:
            own = ", ".join(sorted(kind.subscribes)) or "none"
            raise MisuseError(f"act: {kind.name} does not respond to {name}; it responds to {own}")
        if reason := refusal(name):
            raise MisuseError(f"act: {reason}")

    if isinstance(act, str | EventType):
        name = act if isinstance(act, str) else act.name
        check(name)
        event_type = known[name]
        return (
            DataActions(event_type) if event_type.fields.all else EventActions([None, event_type()])
        )
    events = [act] if isinstance(act, Event) else list(act)
    for event in events:
        if event is not None:
            check(event.type)
    # A single event would be no choice.
    return EventActions([None, *events] if isinstance(act, Event) else events)


class EventActions(Acting):
    """Actions that are numbers of events; None sends nothing."""

    def __init__(self, events: Sequence[Event | None]) -> None:
        if not events:
            raise MisuseError("act: the list is empty; expected events, or None for no event")
        self._events = events
        self.space: AnySpace = spaces.Discrete(len(events))
        numbers: dict[str, list[int]] = {}
        for number, event in enumerate(events):
            if event is not None:
                numbers.setdefault(event.type, []).append(number)
        # For each event type, its events as rows of a batch, and which row a number is: -1 is none.
        self._batches: list[tuple[Events | None, NDArray[np.intp]]] = []
        for chosen in numbers.values():
            rows = np.full(len(events), -1)
            rows[chosen] = np.arange(len(chosen))
            bare = [replace(cast("Event", events[number]), receivers=()) for number in chosen]
            self._batches.append((Events.of(bare), rows))

    def events(self, agents: Ids, actions: Rows) -> list[AnyEvent]:
        """The events of actions in a batch for each event type."""
        numbers = np.asarray(actions)
        counted = numbers.dtype.kind in "iu" and numbers.shape == (len(agents),)
        if not (len(agents) and counted and self._are_choices(numbers)):
            return super().events(agents, actions)
        sent: list[AnyEvent] = []
        for batch, row_of in self._batches:
            if batch is None:
                return super().events(agents, actions)
            rows = row_of[numbers]
            acting = np.flatnonzero(rows >= 0)
            if len(acting):
                receivers = agents if len(acting) == len(agents) else agents.take(acting)
                sent.append(replace(batch.take(rows[acting]), receivers=receivers))
        return sent

    def _are_choices(self, numbers: NDArray[Any]) -> bool:
        return bool(numbers.min() >= 0 and numbers.max() < len(self._events))

    def event(self, agent: str, action: Any) -> Event | None:
        """The event of a number, for one agent. Raises MisuseError."""
        event = self._events[_index(action, len(self._events), agent)]
        return None if event is None else replace(event, receivers=(agent,))


class DataActions(Acting):
    """Actions that are the data of an event type."""

    def __init__(self, event_type: EventType) -> None:
        self._type = event_type
        self._fields = [field for field in event_type.fields.all if _chosen(field, event_type)]
        if not self._fields:
            raise MisuseError(
                f"act: no datum of {event_type.name} can be an action; give events to choose from:"
                f" act=[None, {event_type.name}(...)]"
            )
        self._names = [field.name for field in self._fields]
        types = [field.type for field in self._fields]
        self._choices = [choices_of(type_) for type_ in types]
        self._tables = [np.array(choices) for choices in self._choices]
        self.space: AnySpace = self._joined(types)

    def _joined(self, types: Sequence[Type]) -> AnySpace:
        if all(type_.kind == "real" for type_ in types):
            low, high = zip(*map(limits_of, types), strict=True)
            return spaces.Box(np.array(low), np.array(high), dtype=np.float64)
        counts = [len(choices) for choices in self._choices]
        if all(counts):
            return spaces.Discrete(counts[0]) if len(counts) == 1 else spaces.MultiDiscrete(counts)
        return spaces.Dict(
            {field.name: _space(field.type) for field in self._fields}  # pyright: ignore[reportArgumentType]
        )

    def events(self, agents: Ids, actions: Rows) -> list[AnyEvent]:
        """The events of actions in a batch, made from columns unless actions are dictionaries."""
        if not isinstance(self.space, spaces.Dict) and len(agents):
            # What does not fit is an error of one agent, which the single events below name.
            with suppress(ValueError, TypeError, MisuseError):
                kind = np.float64 if isinstance(self.space, spaces.Box) else None
                rows = np.array(actions, kind).reshape(len(agents), len(self._fields))
                columns = map(_column_of, self._tables, rows.T)
                data: dict[str, Any] = dict(zip(self._names, columns, strict=True))
                return [self._type(**data, receivers=agents)]
        return super().events(agents, actions)

    def event(self, agent: str, action: Any) -> Event | None:
        """An event with these data, for one agent. Raises MisuseError."""
        data = {
            field.name: _index_value(choices, part, agent) if choices else _number(part)
            for field, choices, part in zip(
                self._fields, self._choices, self._parts(agent, action), strict=True
            )
        }
        try:
            return self._type(**data, receivers=[agent])
        except MisuseError as error:
            raise MisuseError(f"the action of {agent}: {error}") from None

    def _parts(self, agent: str, action: Any) -> Sequence[Any]:
        """The part of an action for each datum."""
        if isinstance(self.space, spaces.Discrete):
            return [action]
        if isinstance(self.space, spaces.Dict):
            named = cast("Mapping[str, Any]", action if isinstance(action, Mapping) else {})
            parts = [named[field.name] for field in self._fields if field.name in named]
        else:
            parts = list(np.asarray(action).reshape(-1))
        if len(parts) != len(self._fields):
            names = ", ".join(field.name for field in self._fields)
            raise MisuseError(
                f"the action of {agent} is {action!r:.60}; expected {len(self._fields)} values:"
                f" {names} of {self._type.name}"
            )
        return parts


def choices_of(type_: Type) -> Sequence[Any]:
    """The values of a type, if they are few: bools, words, whole numbers in a range; else none."""
    if type_.kind == "bool":
        return (False, True)
    if type_.words:
        return type_.words
    if type_.kind == "int" and type_.range is not None:
        least, most = type_.range.least, type_.range.most
        if math.isfinite(least) and math.isfinite(most) and most - least < MAX_CHOICES:
            return range(math.ceil(least), math.floor(most) + 1)
    return ()


def limits_of(type_: Type) -> tuple[float, float]:
    """The least and the greatest value of a number type, in its unit."""
    if type_.range is None:
        return -math.inf, math.inf
    return float(type_.range.least), float(type_.range.most)


def _chosen(field: Field, event_type: EventType) -> bool:
    """Whether a datum is part of the action; others have their default. Raises MisuseError."""
    if field.type.kind in ("real", "int", "bool") or field.type.words:
        return True
    if field.default is None:
        raise MisuseError(
            f"act: {field.name} of {event_type.name} is a {field.type}, which cannot be an action;"
            f" expected numbers, bools or Literal words, a default of {field.name}, or events to"
            f" choose from: act=[None, {event_type.name}(...)]"
        )
    return False


def _space(type_: Type) -> AnySpace:
    choices = choices_of(type_)
    if choices:
        return spaces.Discrete(len(choices))
    low, high = limits_of(type_)
    if type_.kind == "int":
        bounds = np.iinfo(np.int64)
        return spaces.Box(int(max(low, bounds.min)), int(min(high, bounds.max)), (), np.int64)
    return spaces.Box(low, high, (), np.float64)


def _number(part: Any) -> Any:
    """A number of numpy, or an array with one number, as a Python object."""
    item = getattr(part, "item", None)
    return item() if callable(item) and np.size(part) == 1 else part


def _column_of(choices: NDArray[Any], parts: NDArray[Any]) -> NDArray[Any]:
    """The column of a datum from a part of each action. Raises ValueError if one is no choice."""
    if not len(choices):
        return parts
    if parts.dtype.kind not in "iu" or parts.min() < 0 or parts.max() >= len(choices):
        raise ValueError(f"expected numbers from 0 to {len(choices) - 1}")
    return choices[parts]


def _index_value(choices: Sequence[Any], part: Any, agent: str) -> Any:
    return choices[_index(part, len(choices), agent)]


def _index(action: Any, count: int, agent: str) -> int:
    number = _number(action)
    if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < count:
        raise MisuseError(
            f"the action of {agent} is {number!r:.60}; expected a number from 0 to {count - 1}"
        )
    return number
