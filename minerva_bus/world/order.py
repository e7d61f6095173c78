"""The total order of a frame's events, an extension of the order relation of 4.2.2."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import cast

from minerva_bus.grammar.batch import AnyEvent, Events, single
from minerva_bus.grammar.events import Event


@dataclass(frozen=True, slots=True)
class Order:
    """An order relation among event types: `types` in order, then all other types by name."""

    types: tuple[str, ...] = ()

    def key(self, event_type: str, source: str, sequence: int) -> tuple[int, str, str, int]:
        """The sort key of an event: priority of its type, type, source, sequence number."""
        known = event_type in self.types
        priority = self.types.index(event_type) if known else len(self.types)
        return priority, event_type, source, sequence


def collect(order: Order, sources: Mapping[str, Sequence[AnyEvent]]) -> tuple[AnyEvent, ...]:
    """E(C*, t), equation 6: all events of all generators, in order, each once.

    `sources` has the events of each source in the order in which it generated them. The events of
    a type become one batch if any of them is in a batch.
    """
    keyed = [
        (order.key(event.type, source, sequence), event)
        for source, events in sources.items()
        for sequence, event in enumerate(events)
    ]
    # The key is a total order: no two events of a frame have the same source and sequence number.
    # So the order in which replies arrive cannot reach the string.
    keyed.sort(key=_first)
    events = [event for _, event in keyed]
    if not any(isinstance(event, Events) for event in events):
        # The condition e^i ∉ z of equation 6. The source is not part of an event, so two generators
        # that report the same event give it once, at its first place in the order.
        return tuple(dict.fromkeys(events))
    collected: list[AnyEvent] = []
    for _, group in groupby(events, lambda event: event.type):
        collected += _each_once(list(group))
    return tuple(collected)


def _each_once(events: list[AnyEvent]) -> Iterable[AnyEvent]:
    """Events of one type, each once; as one batch if their forms agree."""
    if not any(isinstance(event, Events) for event in events):
        return dict.fromkeys(events)
    parts: list[Events | None] = []
    # Runs of single events become batches, so that the order between batches and single events
    # stays.
    for is_batch, group in groupby(events, lambda event: isinstance(event, Events)):
        if is_batch:
            parts += cast("Iterator[Events]", group)
        else:
            parts.append(Events.of(list(cast("Iterator[Event]", group))))
    batch = None if None in parts else Events.concatenated(cast("list[Events]", parts))
    return dict.fromkeys(single(events)) if batch is None else [batch.distinct()]


def _first(pair: tuple[tuple[int, str, str, int], AnyEvent]) -> tuple[int, str, str, int]:
    return pair[0]
