"""The one order of a frame's events: the order relation of 4.2.2 made total."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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


def collect(order: Order, sources: Mapping[str, Sequence[Event]]) -> tuple[Event, ...]:
    """E(C*, t), equation 6: all events of all generators, in order, each once.

    `sources` gives each source's events in the order in which it made them.
    """
    keyed = [
        (order.key(event.type, source, sequence), event)
        for source, events in sources.items()
        for sequence, event in enumerate(events)
    ]
    keyed.sort(key=_first)
    return tuple(dict.fromkeys(event for _, event in keyed))


def _first(pair: tuple[tuple[int, str, str, int], Event]) -> tuple[int, str, str, int]:
    return pair[0]
