"""The work that events cause at hosts, to which the coordinator passes them on.

A message that costs its sender and the coordinator little may cost the hosts much: an event without
receivers goes to every agent of the world, and each evaluates its condition. So an event counts as
several of the limited single events if hosts have much work with it. Section 14 of PROTOCOL.md has
the rules. A weight depends on the event and the string alone, not on the time that a host needs.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Final

import numpy as np

from minerva_bus.frame.composition import Composition, ids_of
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Value
from minerva_bus.grammar.vocabulary import Vocabulary

MAX_SINGLE_EVENTS: Final = 2_000
"""Maximum events of one generator, outside columns, in a frame."""

MAX_HOST_EVENTS: Final = 8_000
"""Maximum events of one host, outside columns, in a frame."""

STEPS: Final = 250
"""Steps of hosts for which an event weighs 1 more; a step is an event for an agent."""

PART: Final = 10
"""Steps of an event for a part of a population, which is evolved by columns."""

ROWS: Final = 20
"""Agents in columns that take one step more."""

LETTERS: Final = 8
"""Characters of a condition that take as long as the event itself: about one comparison."""

BYTES: Final = 32_768
"""Bytes of data for which an event weighs 1 more: a frame has all of its events in one message."""

SEARCHED: Final = 10_000
"""Events of a batch of a host up to which its receivers are searched for in the string."""

FEW: Final = 8
"""Events of a message up to which they are not weighed if none has a condition."""


class EventWork:
    """Weighs events by the agents that the string has now.

    `most_of_generator`, `most_of_host`: the limits of a member's events in a frame.
    """

    def __init__(self, composition: Composition, vocabulary: Vocabulary) -> None:
        self._composition = composition
        self._vocabulary = vocabulary
        self._responding = cache(self._kinds_of)
        self.most_of_generator: int = MAX_SINGLE_EVENTS
        self.most_of_host: int = MAX_HOST_EVENTS

    def allow(self, of_generator: int, of_host: int) -> None:
        """Set the limits of a world file."""
        self.most_of_generator, self.most_of_host = of_generator, of_host

    def objection(self, events: Sequence[AnyEvent], most: int, limit: str) -> str:
        """Reason why a member may not send these events in one message, or an empty string.

        `limit`: the name of the limit `most`.
        """
        weight = sum(map(self.weight, events))
        return self.over(weight, most, limit, events) if weight > most else ""

    def objection_to_host(self, events: Iterable[AnyEvent]) -> str:
        """As `objection`, for the events that the agents of a host send in a frame."""
        # A search for the receivers of a large population, in each frame, would cost more than all
        # else here, and its agents send to agents like them.
        weighed = [event for event in events if event.receivers is None or len(event) <= SEARCHED]
        return self.objection(weighed, self.most_of_host, "host_events")

    def over(self, weight: int, most: int, limit: str, events: Iterable[AnyEvent]) -> str:
        """Reason for refusing events of a weight over `most`."""
        return (
            f"events weigh {weight} by the work of hosts, over {most}:"
            f" {self.heaviest(events)}; name fewer receivers, shorten conditions and data, or raise"
            f" {limit} in [limits]"
        )

    def heaviest(self, events: Iterable[AnyEvent]) -> str:
        """The most expensive of some events, for a message."""
        event = max(events, key=self.steps)
        condition = f" with a condition of {len(event.condition)} characters"
        return (
            f"the heaviest is {event.type}, {self._deliveries(event)} times for an agent"
            f"{condition if event.condition else ''}"
        )

    def weight(self, event: AnyEvent) -> int:
        """The number of single events as which an event or a batch counts, at least 1."""
        return 1 + self.steps(event) // STEPS + _size(event) // BYTES

    def steps(self, event: AnyEvent) -> int:
        """The work of hosts with an event or a batch."""
        return self._deliveries(event) * (1 + len(event.condition) // LETTERS)

    def _deliveries(self, event: AnyEvent) -> int:
        """The agents to which an event goes; fewer if they are in columns."""
        if not event.receivers:
            return len(event) * self._everyone(event.type)
        if isinstance(event, Event):
            return len(event.receivers)
        return self._of_batch(event.receivers)

    def _everyone(self, event_type: str) -> int:
        kinds, composition = self._responding(event_type), self._composition
        single = sum(count for kind, count in composition.single.items() if kind in kinds)
        parts = [part.count for part in composition.parts.values() if part.symbol in kinds]
        return single + sum(PART + count // ROWS for count in parts)

    def _kinds_of(self, event_type: str) -> frozenset[str]:
        kinds = self._vocabulary.kinds.items()
        return frozenset(name for name, kind in kinds if event_type in kind.subscribes | kind.views)

    def _of_batch(self, receivers: Ids) -> int:
        single, steps = len(receivers), 0
        for part in self._composition.parts.values():
            rows = ids_of(part).rows_of(receivers)
            there = rows[rows >= 0]
            if len(there):
                # A population takes a batch in as many passes as one of its agents has events.
                steps += int(np.bincount(there).max()) * PART + len(there) // ROWS
                single -= len(there)
        return single + steps


def _size(event: AnyEvent) -> int:
    """The approximate number of bytes of the data of an event or a batch."""
    if isinstance(event, Events):
        return sum(column.array.nbytes for column in event.columns)
    return sum(map(_length, event.values))


def _length(value: Value) -> int:
    if isinstance(value, str):
        return len(value)
    if isinstance(value, tuple):
        return sum(map(_length, value))
    return value.nbytes if isinstance(value, np.ndarray) else 8


def are_light(events: Sequence[AnyEvent]) -> bool:
    """Whether events are so few and simple that nothing is gained by weighing them."""
    return len(events) <= FEW and not any(e.condition or isinstance(e, Events) for e in events)
