"""Events of one type for a method that takes all events of a frame in one call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from minerva_bus.grammar.columns import Rows
from minerva_bus.grammar.events import AnyEvent, Event, Events, as_batch
from minerva_bus.grammar.ids import Ids


class EventBatch:
    """n events of one type; data by name are arrays of shape (n,).

    Iterating yields single events, which are created only then. Separate from `Events`, whose own
    attributes (`count`, `columns`) would hide data with these names.
    """

    __slots__ = ("_chosen", "_events", "_row")

    def __init__(self, events: Events, row: Rows | None = None, chosen: Rows | None = None) -> None:
        self._events = events
        self._chosen = chosen
        self._row = row

    @property
    def row(self) -> Rows:
        """The row of each event's receiver, shape (n,)."""
        return np.arange(self._events.count) if self._row is None else self._row

    @property
    def sender(self) -> Ids | None:
        """The senders; None if a generator made the events."""
        return self._selected().senders

    def __len__(self) -> int:
        return self._events.count if self._chosen is None else len(self._chosen)

    def __iter__(self) -> Iterator[Event]:
        return iter(self._selected())

    def __getattr__(self, name: str) -> Any:
        if name in self.__slots__:  # not set yet, as in copy.copy()
            raise AttributeError(name)
        events = self._selected()
        if name not in events.names:
            known = ", ".join(events.names) or "no data"
            raise AttributeError(f"{events.type} has no {name}; it has {known}")
        return events.data(name)

    def _selected(self) -> Events:
        if self._chosen is not None:  # as late as possible: most methods read few columns
            self._events, self._chosen = self._events.take(self._chosen), None
        return self._events


def joined(parts: Sequence[Events]) -> Events | None:
    """Events of one type for known agents, as one batch; None if their forms differ.

    If only a part of them names receivers, the batch names none.
    """
    batch = Events.concatenated(parts)
    if batch is None:
        # The receivers are known here, and single events and batches may name them differently.
        batch = Events.concatenated([replace(part, receivers=None) for part in parts])
    return batch


def merged(items: Sequence[AnyEvent]) -> Sequence[Events]:
    """Events of one type for one agent, in order, as one batch if their forms agree."""
    parts = [as_batch(item) for item in items]
    batch = joined(parts)
    return parts if batch is None else [batch]
