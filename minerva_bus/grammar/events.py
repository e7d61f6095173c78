"""Events e^d_c (3.2): type d, data e, condition c, sender and receivers; batches of one type.

A batch holds events as columns with a row for each. An `Event` is the row of a batch, and has its
interface: `len()` is 1, iterating yields the event, and the functions of this module take both. It
holds values instead of arrays of length 1: creating an event takes 0.7 µs, a batch of one row 12
µs, more than most methods take.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import Column, Rows, are_texts, bits
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Value
from minerva_bus.grammar.text_and_digest import same_values, value_text


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
        """1: an event has the interface of a batch (grammar/events.py) with one row."""
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


MANY: Final = 1_000
"""A generator's events are sent as columns if there are more: decoding single events is slow."""

MOST_SINGLE: Final = 1_000_000
"""Single events that a service or an agent may make in a frame: a loop without end stops there."""

_MIX: Final = np.uint64(0xBF58476D1CE4E5B9)


@dataclass(frozen=True, slots=True, eq=False)
class Events:
    """`count` events of one type, in order.

    `senders` and `receivers` have one id for each event. None means no sender, or that the events
    are for every agent that subscribes to the type. All have the same condition.
    """

    type: str
    names: tuple[str, ...]
    columns: tuple[Column, ...]
    count: int
    condition: str = ""
    senders: Ids | None = None
    receivers: Ids | None = None

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[Event]:
        """Single events, row by row."""
        lists = [column.list() for column in self.columns]
        rows: Iterable[tuple[Value, ...]] = zip(*lists, strict=True) if lists else [()] * self.count
        senders = self.senders.texts() if self.senders is not None else [""] * self.count
        receivers = self._receivers()
        for values, sender, to in zip(rows, senders, receivers, strict=True):
            yield Event(self.type, self.names, values, self.condition, sender, to)

    def _receivers(self) -> list[tuple[str, ...]]:
        if self.receivers is None:
            return [()] * self.count
        return [(text,) for text in self.receivers.texts()]

    def event(self, row: int) -> Event:
        """The event of one row."""
        return next(iter(self.take(slice(row, row + 1))))

    @staticmethod
    def repeated(event: Event, count: int) -> Events:
        """A batch of `count` copies of an event."""
        rows = np.zeros(count, np.intp)
        columns = tuple([Column.of([value]).take(rows) for value in event.values])
        to = Ids.of(event.receivers).take(rows) if event.receivers else None
        sender = Ids.of([event.sender]).take(rows) if event.sender else None
        return Events(event.type, event.names, columns, count, event.condition, sender, to)

    def take(self, rows: Rows | slice) -> Events:
        """The events of these rows."""
        count = len(range(*rows.indices(self.count))) if isinstance(rows, slice) else len(rows)
        return Events(
            self.type,
            self.names,
            tuple([column.take(rows) for column in self.columns]),
            count,
            self.condition,
            self.senders.take(rows) if self.senders is not None else None,
            self.receivers.take(rows) if self.receivers is not None else None,
        )

    def data(self, name: str) -> NDArray[Any]:
        """The values of a datum, shape (count,)."""
        return self.columns[self.names.index(name)].array

    def to(self, receiver: str) -> Events:
        """The events for one agent; the same object if all are."""
        if self.receivers is None:
            return self
        rows = np.flatnonzero(Ids.of([receiver]).rows_of(self.receivers) >= 0)
        return self if len(rows) == self.count else self.take(rows)

    @staticmethod
    def of(events: Sequence[Event]) -> Events | None:
        """Events as a batch; None if their forms differ or their data are not scalars."""
        first = events[0]
        alike = all(
            event.type == first.type
            and event.names == first.names
            and event.condition == first.condition
            # A column of receivers has one id for each event.
            and len(event.receivers) == len(first.receivers) < 2
            and bool(event.sender) == bool(first.sender)
            for event in events
        )
        if not alike:
            return None
        columns = tuple(map(Column.of, zip(*[event.values for event in events], strict=True)))
        # Lists, matrices and strings cannot be columns.
        if any(column.array.dtype == object and not are_texts(column.list()) for column in columns):
            return None
        senders = Ids.of([event.sender for event in events]) if first.sender else None
        receivers = Ids.of([event.receivers[0] for event in events]) if first.receivers else None
        return Events(
            first.type, first.names, columns, len(events), first.condition, senders, receivers
        )

    @property
    def form(self) -> tuple[object, ...]:
        """What batches have in common that can be one."""
        dtypes = [column.dtype for column in self.columns]
        ids = self.senders is None, self.receivers is None
        return self.type, self.names, self.condition, ids, tuple(dtypes)

    @staticmethod
    def concatenated(parts: Sequence[Events]) -> Events | None:
        """Several batches as one; None if they differ in more than their rows."""
        first = parts[0]
        if len(parts) == 1:
            return first
        if len({part.form for part in parts}) > 1:
            return None
        columns = tuple(
            map(Column.concatenated, zip(*[part.columns for part in parts], strict=True))
        )
        count = sum(part.count for part in parts)
        return Events(
            first.type,
            first.names,
            columns,
            count,
            first.condition,
            _all([part.senders for part in parts]),
            _all([part.receivers for part in parts]),
        )

    def distinct(self) -> Events:
        """Each event once, at its first occurrence (equation 6)."""
        if self.count < 2:
            return self
        kept = self.first_occurrences()
        return self if kept.all() else self.take(np.flatnonzero(kept))

    def first_occurrences(self) -> NDArray[np.bool_]:
        """Which events equal no earlier one, shape (count,)."""
        kept = np.ones(self.count, np.bool_)
        ends = (self.senders, self.receivers)
        if self.count < 2 or any(ids is not None and ids.distinct for ids in ends):
            return kept
        # Such as the angles of a scan. The search below takes at least six times as long.
        if any(map(_ascends, self.columns)):
            return kept
        # Equal hashes select candidates with one sort of integers; only these are compared in full.
        hashes = self._hashes()
        order = np.argsort(hashes)
        begins = np.flatnonzero(np.concatenate(([True], np.diff(hashes[order]) != 0)))
        sizes = np.diff(begins, append=self.count)
        order, sizes, begins = _repeated(order, sizes, begins)
        if not len(order):
            return kept
        # The sort is not stable, so the first event of equal ones is the one with the least number.
        firsts = np.repeat(np.minimum.reduceat(order, begins), sizes)
        arrays = self._arrays()
        equal = np.ones(len(order), np.bool_)
        for array in arrays:
            equal &= array[order] == array[firsts]
        if equal.all():
            kept[order] = order == firsts
            return kept
        # Different events have one hash.
        known: set[tuple[Any, ...]] = set()
        rows = np.sort(order)
        values = zip(*[array[rows].tolist() for array in arrays], strict=True)
        for row, event in zip(rows.tolist(), values, strict=True):
            kept[row] = event not in known
            known.add(event)
        return kept

    def _arrays(self) -> list[NDArray[Any]]:
        """Data that are equal if and only if the events are."""
        known = [ids.data for ids in (self.senders, self.receivers) if ids is not None]
        return [*[bits(column.array) for column in self.columns], *known]

    def _hashes(self) -> NDArray[np.uint64]:
        hashes = np.zeros(self.count, np.uint64)
        for column in self.columns:
            array = column.array
            if array.dtype == object:
                # This hash differs between processes, but it selects candidates only and is not
                # part of the result.
                word = np.array([hash(text) & 0xFFFFFFFFFFFFFFFF for text in array], np.uint64)
            else:
                word = bits(array).astype(np.int64).view(np.uint64)
            hashes = _mixed(hashes, word)
        for ids in (self.senders, self.receivers):
            if ids is not None:
                # Numbered ids are mixed by their numbers: hashes would first spell each id.
                hashes = _mixed(hashes, ids.data.view(np.uint64) if ids.stem else ids.hashes)
        return hashes


AnyEvent: TypeAlias = Event | Events


def single(events: Iterable[AnyEvent]) -> Iterator[Event]:
    """Single events, in order."""
    return chain.from_iterable(events)


def first_of(event: AnyEvent) -> Event:
    """The event, or the first one of a batch."""
    return event.event(0) if isinstance(event, Events) else event


def as_batch(event: AnyEvent, count: int = 1) -> Events:
    """The batch, or `count` copies of an event as one."""
    return event if isinstance(event, Events) else Events.repeated(event, count)


def senders_of(event: AnyEvent) -> Ids | None:
    """The sender of an event, or those of a batch; None if a generator made it."""
    if isinstance(event, Events):
        return event.senders
    return Ids.of([event.sender]) if event.sender else None


def chosen(event: AnyEvent, rows: Rows) -> tuple[AnyEvent, ...]:
    """The event, or these rows of a batch; nothing without any rows."""
    if not len(rows):
        return ()
    return (event.take(rows),) if isinstance(event, Events) else (event,)


def check_number(made: int) -> None:
    """Raise MisuseError if so many single events have been made in a frame by one call or agent."""
    if made >= MOST_SINGLE:
        raise MisuseError(
            f"it makes more than {MOST_SINGLE:,} events in a frame: end its loop, or make batches,"
            " such as eNear(distance=array)"
        )


def in_columns(events: tuple[AnyEvent, ...]) -> tuple[AnyEvent, ...]:
    """Events with those of each type as one batch if possible; at most `MANY` remain as they are.

    The order within each type is kept; no other order matters.
    """
    if len(events) <= MANY:
        return events
    by_type = groupby(sorted(events, key=_by_type), _by_type)
    return tuple([event for _, alike in by_type for event in batched(alike)])


def batched(events: Iterable[AnyEvent]) -> Iterator[AnyEvent]:
    """Events of one type, with those between two batches as one batch if possible."""
    for is_batch, group in groupby(events, lambda event: isinstance(event, Events)):
        run = list(group)
        batch = None if is_batch else Events.of(cast("list[Event]", run))
        yield from run if batch is None else [batch]


def _by_type(event: AnyEvent) -> str:
    return event.type


def _repeated(order: Rows, sizes: Rows, begins: Rows) -> tuple[Rows, Rows, Rows]:
    """The rows, sizes and begins of those groups in an order that have several rows."""
    several = sizes > 1
    if several.all():
        return order, sizes, begins
    kept = sizes[several]
    return order[np.repeat(several, sizes)], kept, np.cumsum(kept) - kept


def _mixed(hashes: NDArray[np.uint64], word: NDArray[np.uint64]) -> NDArray[np.uint64]:
    hashes = (hashes ^ word) * _MIX
    return hashes ^ (hashes >> np.uint64(31))


def _ascends(column: Column) -> bool:
    """Whether each number of a column is larger than the one before, so that none occurs twice."""
    array = column.array
    return array.dtype.kind in "if" and bool((array[1:] > array[:-1]).all())


def _all(parts: Sequence[Ids | None]) -> Ids | None:
    known = [part for part in parts if part is not None]
    return Ids.concatenated(known) if known else None
