"""The one order of a frame's events: the order relation of 4.2.2 made total."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import cast

from minerva_bus.grammar.batch import AnyEvent, Events, single
from minerva_bus.grammar.events import Event


@dataclass(frozen=True, slots=True)
class Order:
    """An order relation among event types: the first of `types` goes first.

    Types that it does not list come after all that it does, by name.
    """

    types: tuple[str, ...] = ()

    def key(self, event_type: str, source: str, sequence: int) -> tuple[int, str, str, int]:
        """The order key: priority of the type, type, source's name, sequence number."""
        known = event_type in self.types
        priority = self.types.index(event_type) if known else len(self.types)
        return priority, event_type, source, sequence


def collect(order: Order, sources: Mapping[str, Sequence[AnyEvent]]) -> tuple[AnyEvent, ...]:
    """E(C*, t), equation 6: all events of all generators, in order, each once.

    `sources` has each source's events in the order in which it made them. The events of a type
    become one batch if some of them are in a batch.
    """
    keyed = [
        (order.key(event.type, source, sequence), event)
        for source, events in sources.items()
        for sequence, event in enumerate(events)
    ]
    keyed.sort(key=_first)
    events = [event for _, event in keyed]
    if not any(isinstance(event, Events) for event in events):
        return tuple(dict.fromkeys(events))
    found: list[AnyEvent] = []
    for _, group in groupby(events, lambda event: event.type):
        found += _each_once(list(group))
    return tuple(found)


def _each_once(events: list[AnyEvent]) -> Iterable[AnyEvent]:
    """Events of one type, each once; in columns where they all can be."""
    if not any(isinstance(event, Events) for event in events):
        return dict.fromkeys(events)
    parts: list[Events | None] = []
    for is_batch, group in groupby(events, lambda event: isinstance(event, Events)):
        if is_batch:
            parts += cast("Iterator[Events]", group)
        else:
            parts.append(Events.of(list(cast("Iterator[Event]", group))))
    whole = None if None in parts else Events.concatenated(cast("list[Events]", parts))
    return dict.fromkeys(single(events)) if whole is None else [whole.distinct()]


def _first(pair: tuple[tuple[int, str, str, int], AnyEvent]) -> tuple[int, str, str, int]:
    return pair[0]
