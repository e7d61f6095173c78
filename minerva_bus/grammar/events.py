"""Events e^d_c (3.2): type d, data e, condition c, sender and receivers."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from minerva_bus.grammar.digest import same_values
from minerva_bus.grammar.printer import value_text
from minerva_bus.grammar.scene import Value


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """One event. Its data can be read as attributes: `near.distance`.

    Without receivers it is for every agent whose kind subscribes to its type; `sender` is the
    agent that emitted it, or empty if a generator did. Two events are equal if type, data,
    condition, sender and receivers are. Which generator made them does not count (equation 6), so
    two sensors that see the same report it once.
    """

    type: str
    names: tuple[str, ...] = ()
    values: tuple[Value, ...] = ()
    condition: str = ""
    sender: str = ""
    receivers: tuple[str, ...] = ()

    @property
    def data(self) -> Mapping[str, Any]:
        """Data by name."""
        return dict(zip(self.names, self.values, strict=True))

    def __getattr__(self, name: str) -> Any:
        if name in _SLOTS:  # not set yet: an event that is being copied or unpickled
            raise AttributeError(name)
        try:
            return self.values[self.names.index(name)]
        except ValueError:
            known = ", ".join(self.names) or "no data"
            raise AttributeError(f"{self.type} has no {name}; it has {known}") from None

    def __len__(self) -> int:
        """1: an event has the interface of a batch (grammar/batch.py) with one row."""
        return 1

    def __iter__(self) -> Iterator[Event]:
        """The event itself, as a batch yields its rows."""
        yield self

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Event):
            return NotImplemented
        # Values by `same_values`: matrices have no single truth value, and 0.0 and -0.0 differ.
        return (
            self.type == other.type
            and self.receivers == other.receivers
            and self.sender == other.sender
            and self.condition == other.condition
            and self.names == other.names
            and same_values(self.values, other.values)
        )

    def __hash__(self) -> int:
        return hash((self.type, self.receivers, self.sender, tuple(map(_hashable, self.values))))

    def data_text(self) -> str:
        """`name=value, ...` in the text of the language."""
        pairs = zip(self.names, self.values, strict=True)
        return ", ".join(f"{name}={value_text(value)}" for name, value in pairs)

    def __str__(self) -> str:
        shown = f"{self.type}<{self.data_text()}>" if self.names else self.type
        condition = f" if {self.condition}" if self.condition else ""
        sender = f" from #{self.sender}" if self.sender else ""
        to = f" to {', '.join('#' + who for who in self.receivers)}" if self.receivers else ""
        return shown + condition + sender + to


def _refuse(event: Event, name: str, _: object) -> None:
    raise AttributeError(
        f"{name} of {event.type} cannot be changed: other agents receive the same event;"
        f" make a new one, {event.type}(...)"
    )


# The method of a frozen class with slots fails by itself for names that are no fields, such as the
# data of the event, with a TypeError about super().
type.__setattr__(Event, "__setattr__", _refuse)

_SLOTS = frozenset(("type", "names", "values", "condition", "sender", "receivers"))


def _hashable(value: Value) -> Hashable:
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if not isinstance(value, tuple):
        return value
    try:
        hash(value)  # Without a call for each of its lists.
    except TypeError:  # There is a matrix in it.
        return tuple(map(_hashable, value))
    return value
