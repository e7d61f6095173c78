"""Factories for events of a world's own types, without importing its vocabulary.

A type is looked up and checked once, when a service joins; creating an event afterwards only
arranges values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.columns import Column
from minerva_bus.grammar.events import Event, Events
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Value
from minerva_bus.grammar.types import type_of
from minerva_bus.grammar.vocabulary import EventType
from minerva_bus.world.services import WorldInfo


def event_type(service: str, world: WorldInfo, name: str) -> EventType:
    """Look up an event type of the world. Raises MisuseError, naming the service."""
    known = world.vocabulary.events
    if name not in known:
        raise MisuseError(
            f"{service}: the world {world.world!r} has no event type {name}"
            f"{nearest(name, list(known))}"
        )
    return known[name]


class EventFactory:
    """Creates events of one type from values in the order given to the constructor."""

    def __init__(self, service: str, world: WorldInfo, name: str, **data: Any) -> None:
        """`data` are annotations like those of an event type: `dist=Metres`.

        Raises MisuseError if the world's type lacks one of them or requires others; a number
        without a unit in the vocabulary accepts any.
        """
        declared = event_type(service, world, name)
        _compare(service, declared, data)
        fields = declared.fields
        self._type = declared.name
        self._names = fields.names
        self._rest: list[Value | None] = [field.default for field in fields.all]
        self._places = tuple([fields.names.index(name) for name in data])
        self._in_order = tuple(data) == fields.names

    def __call__(self, *values: Value, receivers: tuple[str, ...] = ()) -> Event:
        """An event with these values, already in their final form, for these receivers."""
        if not self._in_order:
            values = self._arranged(values)
        # Not through the event type, which would check every value again: the constructor has
        # compared the types, and a scan makes hundreds of events per frame.
        return Event(self._type, self._names, values, "", "", receivers)

    def many(self, columns: Sequence[NDArray[Any]], receiver: str) -> Events:
        """Many events for one agent, one column per value; shape (n,) each."""
        count = len(columns[0])
        arranged = [Column(column) for column in columns]
        if not self._in_order:
            columns_by_place = dict(zip(self._places, arranged, strict=True))
            same = np.zeros(count, np.intp)
            arranged = [
                columns_by_place[place]
                if place in columns_by_place
                else Column.of([cast("Value", default)]).take(same)
                for place, default in enumerate(self._rest)
            ]
        to = Ids.of([receiver]).take(np.zeros(count, np.intp))
        return Events(self._type, self._names, tuple(arranged), count, receivers=to)

    def _arranged(self, values: tuple[Value, ...]) -> tuple[Value, ...]:
        arranged: list[Any] = self._rest.copy()
        for place, value in zip(self._places, values, strict=True):
            arranged[place] = value
        return tuple(arranged)


def _compare(service: str, declared: EventType, data: dict[str, Any]) -> None:
    """Check that the declared type accepts the data. Raises MisuseError."""
    fields = {field.name: field for field in declared.fields.all}
    for name, annotation in data.items():
        produced = type_of(annotation)
        if name not in fields:
            listed = ", ".join(fields) or "none"
            raise MisuseError(
                f"{service}: {declared.name} has no {name} ({produced}) among its data ({listed})"
            )
        wanted = fields[name].type
        if wanted.kind != produced.kind or wanted.unit not in ("", produced.unit):
            raise MisuseError(
                f"{service}: {declared.name} declares {name} as {wanted};"
                f" {service} provides {produced}"
            )
    for name, field in fields.items():
        if name not in data and field.default is None:
            raise MisuseError(
                f"{service}: {declared.name} needs {name} ({field.type}), which {service} does not"
                " make; give it a default in the vocabulary"
            )
