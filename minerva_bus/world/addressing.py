"""Whom events concern among agents in columns, in rounds in which each agent has one at most."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.columns import Rows
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.ids import Ids

Round: TypeAlias = tuple[AnyEvent, Rows | None]
"""Events and the rows of their agents, each row once; None: one event for all."""


def turns(item: AnyEvent, ids: Ids, *, at_once: bool) -> Iterator[Round]:
    """An event's agents; several events in turns, so that no agent has two in one."""
    if isinstance(item, Events):
        if item.receivers is None:
            for event in item:
                yield event, None
        else:
            yield from _each_once(item, ids.rows_of(item.receivers), at_once=at_once)
    elif not item.receivers:
        yield item, None
    else:
        rows = ids.rows_of(Ids.of(item.receivers))
        rows = np.sort(rows[rows >= 0])
        if len(rows):
            yield item, rows


def _each_once(events: Events, rows: Rows, *, at_once: bool) -> Iterator[Round]:
    here = rows >= 0
    if not here.all():
        chosen = np.flatnonzero(here)
        events, rows = events.take(chosen), rows[chosen]
    if not len(rows):
        return
    if at_once or (rows[1:] > rows[:-1]).all():
        yield events, rows
        return
    order = np.argsort(rows, kind="stable")
    ordered = rows[order]
    begins = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1])))
    lengths = np.diff(np.append(begins, len(ordered)))
    turn = np.arange(len(ordered)) - np.repeat(begins, lengths)
    for number in range(int(lengths.max())):
        chosen = order[turn == number]
        yield events.take(chosen), rows[chosen]


def narrowed(event: AnyEvent, rows: Rows | None, keep: NDArray[np.bool_]) -> Round | None:
    """A round with those only that are to be kept; None: nobody is left."""
    if isinstance(event, Event):
        left = np.flatnonzero(keep) if rows is None else rows[keep[rows]]
        return (event, left) if len(left) else None
    assert rows is not None
    chosen = np.flatnonzero(keep[rows])
    return (event.take(chosen), rows[chosen]) if len(chosen) else None
