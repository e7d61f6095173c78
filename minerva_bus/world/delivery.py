"""The total order of a frame's events, an extension of the order relation of 4.2.2."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Final, TypeAlias, cast

import numpy as np

from minerva_bus.grammar.events import AnyEvent, Event, Events, single


@dataclass(frozen=True, slots=True)
class Priority:
    """An order relation among event types: `types` in order, then all other types by name."""

    types: tuple[str, ...] = ()

    def key(self, event_type: str, source: str, sequence: int) -> tuple[int, str, str, int]:
        """The sort key of an event: priority of its type, type, source, sequence number."""
        known = event_type in self.types
        priority = self.types.index(event_type) if known else len(self.types)
        return priority, event_type, source, sequence


_Keyed: TypeAlias = tuple[tuple[int, str, str, int], AnyEvent]
_KEY: Final[Callable[[_Keyed], tuple[int, str, str, int]]] = itemgetter(0)
_EVENT: Final[Callable[[_Keyed], AnyEvent]] = itemgetter(1)


def collect(order: Priority, sources: Mapping[str, Sequence[AnyEvent]]) -> tuple[AnyEvent, ...]:
    """E(C*, t), equation 6: all events of all generators, in order, each once.

    `sources` has the events of each source in the order in which it generated them. The events of
    a type become one batch if any of them is in a batch, or several if their forms differ.
    """
    keyed: list[_Keyed] = []
    for source, made in sources.items():
        for sequence, event in enumerate(made):
            keyed.append((order.key(event.type, source, sequence), event))
    # The key is a total order: no two events of a frame have the same source and sequence number.
    # So the order in which replies arrive cannot reach the string.
    keyed.sort(key=_KEY)
    events = list(map(_EVENT, keyed))
    if Events not in map(type, events):
        # The condition e^i ∉ z of equation 6. The source is not part of an event, so two generators
        # that report the same event yield it once, at its first place in the order.
        return tuple(dict.fromkeys(events))
    collected: list[AnyEvent] = []
    for _, group in groupby(events, lambda event: event.type):
        collected += _each_once(list(group))
    return tuple(collected)


def _each_once(events: list[AnyEvent]) -> Iterable[AnyEvent]:
    """Events of one type, each once; as one batch if their forms agree."""
    if not any(isinstance(event, Events) for event in events):
        return dict.fromkeys(events)
    parts = list(_parts(events))
    batches = [part for part in parts if isinstance(part, Events)]
    batch = Events.concatenated(batches) if len(batches) == len(parts) else None
    return _each_once_by_form(parts) if batch is None else [batch.distinct()]


def _parts(events: Iterable[AnyEvent]) -> Iterator[AnyEvent]:
    """Batches, in the order of the events; runs of single events become batches if they can."""
    for is_batch, group in groupby(events, lambda event: isinstance(event, Events)):
        if is_batch:
            yield from group
            continue
        for _, run in groupby(cast("Iterator[Event]", group), _form):
            alike = list(run)
            batch = Events.of(alike)
            # Events with lists, for example, cannot be a batch.
            yield from alike if batch is None else [batch]


def _form(event: AnyEvent) -> tuple[object, ...]:
    """Events of different forms are never equal, and those of one form may become a batch."""
    if isinstance(event, Events):
        receivers = int(event.receivers is not None)
        return event.condition, event.senders is not None, receivers, True
    batched = Events.of([event]) is not None
    return event.condition, bool(event.sender), len(event.receivers), batched


def _each_once_by_form(parts: Sequence[AnyEvent]) -> Iterable[AnyEvent]:
    """The events of batches and single events that differ in form, each once.

    They are not all made single events: a single one could make a million objects of a batch.
    """
    places: dict[tuple[object, ...], list[int]] = {}
    for place, part in enumerate(parts):
        places.setdefault(_form(part), []).append(place)
    kept: list[AnyEvent | None] = [*parts]
    for alike in places.values():
        once = _once([parts[place] for place in alike])
        if once is None:  # Their columns have different types.
            return dict.fromkeys(single(parts))
        for place, part in zip(alike, once, strict=True):
            kept[place] = part
    return [part for part in kept if part is not None]


def _once(alike: Sequence[AnyEvent]) -> list[AnyEvent | None] | None:
    """Parts of one form without repetitions, None for those that are; None if types differ."""
    batches = [part for part in alike if isinstance(part, Events)]
    if not batches:
        first = {event: place for place, event in reversed([*enumerate(alike)])}
        return [event if first[event] == place else None for place, event in enumerate(alike)]
    batch = Events.concatenated(batches)
    if batch is None:
        return None
    kept, end, once = batch.first_occurrences(), 0, list[AnyEvent | None]()
    for part in batches:
        begin, end = end, end + part.count
        rows = np.flatnonzero(kept[begin:end])
        once.append(part.take(rows) if len(rows) else None)
    return once
