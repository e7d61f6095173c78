"""E(C*, t), the events of a frame in their total order (equation 6), and their delivery.

The order extends the order relation of 4.2.2. Events go by id to an agent, by row to a population.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Rows
from minerva_bus.grammar.events import MANY, AnyEvent, Event, Events, batched, chosen, single
from minerva_bus.grammar.ids import Ids


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
        return tuple(dict.fromkeys(events) if len(events) > 1 else events)
    collected: list[AnyEvent] = []
    for _, group in groupby(events, lambda event: event.type):
        collected += _each_once(list(group))
    return tuple(collected)


def _each_once(events: list[AnyEvent]) -> Iterable[AnyEvent]:
    """Events of one type, each once; as one batch if any is in a batch and their forms agree.

    Batches are not made single events: a single event could make a million objects of a batch.
    """
    if Events not in map(type, events):
        return dict.fromkeys(events)
    if len(events) == 1:  # the usual case
        return [_joined(events).distinct()]
    # Neighbours of one form are one batch. Events with lists, for example, have no form.
    batches = [
        event if isinstance(event, Events) else Events.of([event]) or event
        for event in batched(events)
    ]
    parts: list[AnyEvent] = []
    for form, group in groupby(batches, _form):
        alike = list(group)
        parts += alike if form is None else [_joined(alike)]
    # Events of different forms are never equal.
    places: dict[object, list[int]] = {}
    for place, part in enumerate(parts):
        places.setdefault(_form(part), []).append(place)
    once: dict[int, tuple[AnyEvent, ...]] = {}
    for form, of_form in places.items():
        if form is None:
            first = {parts[place]: place for place in reversed(of_form)}
            once |= {place: (event,) for event, place in first.items()}
            continue
        kept = _joined([parts[place] for place in of_form]).first_occurrences()
        ends = np.cumsum([len(parts[place]) for place in of_form])
        for place, rows in zip(of_form, np.split(kept, ends[:-1]), strict=True):
            part = parts[place]
            once[place] = (part,) if rows.all() else chosen(part, np.flatnonzero(rows))
    return [event for place in sorted(once) for event in once[place]]


def by_receiver(events: Iterable[AnyEvent]) -> list[AnyEvent]:
    """The events by type and receiver; those of one receiver keep their order.

    Several processes that divide the agents of a generator then give the events of one.
    """
    ordered: list[AnyEvent] = []
    for _, group in groupby(sorted(events, key=_TYPE), _TYPE):
        alike = list(group)
        parts = list(batched(alike)) if Events in map(type, alike) else alike
        batches = [part for part in parts if isinstance(part, Events)]
        batch = Events.concatenated(batches) if len(batches) == len(parts) else None
        if batch is None or batch.receivers is None:
            ordered += sorted(single(alike), key=attrgetter("receivers"))
        else:
            ordered.append(batch.take(np.argsort(batch.receivers.spelled, kind="stable")))
    return ordered


def _form(event: AnyEvent) -> tuple[object, ...] | None:
    return event.form if isinstance(event, Events) else None


def _joined(alike: Sequence[AnyEvent]) -> Events:
    return cast("Events", Events.concatenated(cast("Sequence[Events]", alike)))


_TYPE: Final = attrgetter("type")
_EVENTS: Final = frozenset[type]((Event, Events))


@dataclass(slots=True)
class Addressed:
    """A frame's events in order, indexed by receiver.

    A batch is not split into events: an agent gets a batch of the rows for it.
    """

    events: tuple[AnyEvent, ...]
    types: frozenset[str] = field(init=False)
    _everyone: dict[str, list[int]] = field(init=False)
    _single: dict[str, list[int]] = field(init=False)
    _batches: dict[str, list[int]] = field(init=False)
    _rows: dict[int, dict[str, list[int]]] = field(init=False)
    """Rows of short batches by receiver, by index; made on demand."""
    _events: dict[int, list[Event]] = field(init=False)
    """Single events of short batches, by index; made on demand."""

    def __post_init__(self) -> None:
        # Events are indexed once by receiver, because each agent looks up its own: scanning all
        # events for each agent would cost agents times events.
        self.types = frozenset(map(_TYPE, self.events))
        self._everyone, self._single, self._batches = {}, {}, {}
        self._rows, self._events = {}, {}
        for index, event in enumerate(self.events):
            if not event.receivers:  # a batch for all has None, and there is no empty batch
                self._everyone.setdefault(event.type, []).append(index)
            elif isinstance(event, Events):
                self._batches.setdefault(event.type, []).append(index)
            else:
                # An event that names a receiver twice is still one event for it.
                for receiver in dict.fromkeys(event.receivers):
                    self._single.setdefault(receiver, []).append(index)

    def to(
        self, agent_id: str, event_types: Container[str], after: int = -1
    ) -> list[tuple[int, AnyEvent]]:
        """The events of these types for an agent, in order, with indexes greater than `after`."""
        events = self.events
        concerning: list[tuple[int, AnyEvent]] = []
        for event_type, indexes in self._everyone.items():
            for index in indexes if event_type in event_types else ():
                if index > after:
                    concerning.append((index, events[index]))
        for index in self._single.get(agent_id, ()):
            if index > after and events[index].type in event_types:
                concerning.append((index, events[index]))
        if self._batches:
            concerning += self._in_batches(agent_id, event_types, after)
        if len(concerning) > 1:  # the three indexes have been read one after another
            concerning.sort(key=itemgetter(0))
        return concerning

    def _in_batches(
        self, agent_id: str, event_types: Container[str], after: int
    ) -> Iterator[tuple[int, AnyEvent]]:
        for event_type, indexes in self._batches.items():
            for index in indexes if event_type in event_types else ():
                batch = self.events[index]
                if index > after and isinstance(batch, Events):
                    own = self._own(index, batch, agent_id)
                    if own:
                        yield index, own

    def _own(self, index: int, batch: Events, agent_id: str) -> AnyEvent:
        """The rows of a batch for an agent; one row is an event, which is faster to process."""
        if batch.count > MANY:  # It is for a population; few other agents receive any of it.
            return batch.to(agent_id)
        if index not in self._rows:
            rows: dict[str, list[int]] = {}
            for row, receiver in enumerate([] if batch.receivers is None else batch.receivers):
                rows.setdefault(receiver, []).append(row)
            self._rows[index] = rows
        own = self._rows[index].get(agent_id, [])
        if len(own) == batch.count > 1:  # Such as the scan of a laser.
            return batch
        if len(own) != 1:
            return batch.take(np.array(own, np.intp))
        # All at once: to make single events of a batch one by one costs twenty times as much.
        if index not in self._events:
            self._events[index] = list(batch)
        return self._events[index][own[0]]


def addressed(events: Sequence[AnyEvent] | Addressed) -> Addressed:
    """Events indexed by receiver; pass the result on, so that the index is built once.

    Raises MisuseError for anything else than events.
    """
    if isinstance(events, Addressed):
        return events
    if not isinstance(events, Iterable):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise MisuseError(f"expected a list of events, not {events!r:.60}")
    listed = tuple(events)
    if not _EVENTS.issuperset(map(type, listed)):
        wrong = next(event for event in listed if type(event) not in _EVENTS)
        raise MisuseError(f"expected an event, such as eTick(), not {wrong!r:.60}")
    return Addressed(listed)


Round: TypeAlias = tuple[AnyEvent, Rows | None]
"""A batch in which each receiver occurs once, and their rows; None for an event to all."""


def rounds(event: AnyEvent, ids: Ids, *, at_once: bool) -> Iterator[Round]:
    """An event, or a batch, for the agents with these ids, in batches of unique receivers.

    With `at_once` it is a single batch, in which a receiver may occur several times.
    """
    if isinstance(event, Events):
        if event.receivers is None:
            for each in event:
                yield each, None
        else:
            yield from _unique(event, ids.rows_of(event.receivers), at_once=at_once)
    elif not event.receivers:
        yield event, None
    else:
        rows = ids.rows_of(Ids.of(event.receivers))
        # Receivers that are not in this population have the row -1. Ascending rows are the order of
        # the string, which the order of emitted events follows.
        rows = np.sort(rows[rows >= 0])
        if len(rows):
            yield event, rows


def _unique(events: Events, rows: Rows, *, at_once: bool) -> Iterator[Round]:
    chosen = np.flatnonzero(rows >= 0)
    if len(chosen) < len(rows):
        events, rows = events.take(chosen), rows[chosen]
    if not len(rows):
        return
    # Ascending rows contain no receiver twice. This is the usual case, and the check saves the
    # sort.
    if at_once or (rows[1:] > rows[:-1]).all():
        yield events, rows
        return
    # Number the events of each receiver in their order: those with number k are round k.
    order = np.argsort(rows, kind="stable")
    ordered = rows[order]
    begins = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1])))
    lengths = np.diff(np.append(begins, len(ordered)))
    turn = np.arange(len(ordered)) - np.repeat(begins, lengths)
    for number in range(int(lengths.max())):
        chosen = order[turn == number]
        yield events.take(chosen), rows[chosen]


def narrowed(event: AnyEvent, rows: Rows | None, keep: NDArray[np.bool_]) -> Round | None:
    """The round for the receivers in the mask `keep`, shape (agents,); None if there are none."""
    places = np.flatnonzero(keep if rows is None else keep[rows])
    if not len(places):
        return None
    return chosen(event, places)[0], places if rows is None else rows[places]
