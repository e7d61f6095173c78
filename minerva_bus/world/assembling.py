"""Results of a population's frame: the string of its agents, and the emitted events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import StateError
from minerva_bus.grammar.column import Column, Rows, bits
from minerva_bus.grammar.columns import Columns, packed, shape_of
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.ids import RowDelta
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene
from minerva_bus.world.population import Birth, Emitted, PopulationState

_FEW_CHANGED = 0.25
"""Up to this part, changed values are put into the old column, which keeps its digests."""

_OF_DTYPE: Final[dict[str, type]] = {"f": float, "i": int, "b": bool, "O": str}
"""The type of a column's values, by the kind of its dtype."""


class Unsound(StateError):
    """An attribute of the agent in `row` is not finite."""

    def __init__(self, name: str, row: int, value: float) -> None:
        super().__init__(f"{name} must be a finite number, not {value}", name)
        self.row = row


def assembled(state: PopulationState, lives: Mapping[int, Scene]) -> Scene:
    """The string of the remaining rows, with newborns after their parents.

    `lives` has the strings of the agents that have left the arrays, by row.
    """
    lives = _unlike(state, lives)
    part = _changed(state)
    if (state.away is None or not state.away.any()) and not state.born:
        return Scene((part,))
    if not lives and all(birth.newborn.symbol == part.symbol for birth in state.born):
        return _in_columns(part, state)
    return packed(_in_pieces(part, state, lives))


def _unlike(state: PopulationState, lives: Mapping[int, Scene]) -> Mapping[int, Scene]:
    """The strings that are not rows of the population; the others are written to `state`.

    A string between the rows would split the columns, and a host sends split columns as a whole.
    """
    unlike: dict[int, Scene] = {}
    staying: dict[int, AgentNode] = {}
    young: list[tuple[int, AgentNode]] = []
    for row, scene in lives.items():
        nodes = _like_rows(scene, state.part)
        own = nodes is not None and bool(nodes) and nodes[0].id == state.ids[row]
        # A newborn before its parent has no place among the newborns of a row.
        if nodes is None or (not own and any(node.id == state.ids[row] for node in nodes)):
            unlike[row] = scene
            continue
        if own:
            staying[row] = nodes[0]
        young += [(row, node) for node in nodes[own:]]
    if staying:
        _keep_rows(state, staying)
    if young:
        newborn = Columns.of([node for _, node in young])
        rows = np.array([row for row, _ in young], np.intp)
        # The last turn of the frame: these newborns are the closest to their parents.
        state.born.append(Birth(rows, state.turn + 1, newborn))
    return unlike


def _like_rows(scene: Scene, part: Columns) -> list[AgentNode] | None:
    """The nodes of a string if all of them could be rows of these columns."""
    types = [_OF_DTYPE[column.dtype.kind] for column in part.columns]
    nodes: list[AgentNode] = []
    for node in scene.nodes:
        if not isinstance(node, AgentNode) or shape_of(node) != part.shape:
            return None
        # numpy would convert a value of another type.
        if list(map(type, node.values)) != types:
            return None
        nodes.append(node)
    return nodes


def _keep_rows(state: PopulationState, staying: Mapping[int, AgentNode]) -> None:
    """Return agents to their rows with their present values."""
    rows = np.array([*staying], np.intp)
    columns = Columns.of([*staying.values()]).columns
    for name, column in zip(state.part.names, columns, strict=True):
        # An attribute that has not changed keeps its column.
        if (bits(state.value(name)[rows]) != bits(column.array)).any():
            state.write(name, rows, column.array)
    if state.away is not None:
        state.away[rows] = False


def _changed(state: PopulationState) -> Columns:
    part = state.part
    columns = [
        _column(state, name, old) for name, old in zip(part.names, part.columns, strict=True)
    ]
    # The same object again: whatever compares by identity finds that nothing has changed.
    if all(new is old for new, old in zip(columns, part.columns, strict=True)):
        return part
    return part.with_columns(columns)


def _column(state: PopulationState, name: str, old: Column) -> Column:
    column = state.column(name)
    if column is old:
        return old
    if column is None:
        _check_finite(state, name, state.arrays[name])
        column = Column(state.arrays[name])
    # Rows will move, which changes every column, so a comparison would show nothing.
    if state.away is not None or state.born:
        return column
    rows = old.differs(column)
    if rows is None or len(rows) >= _FEW_CHANGED * len(column):
        return column
    return old.changed(rows, column) if len(rows) else old


def _check_finite(state: PopulationState, name: str, array: NDArray[Any]) -> None:
    """Raise Unsound for an agent with a number that is not finite, unless it is dead."""
    if array.dtype != np.float64 or np.isfinite(array).all():
        return
    wrong = ~np.isfinite(array) if state.away is None else ~np.isfinite(array) & ~state.away
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise Unsound(name, row, float(array[row]))


def _in_columns(part: Columns, state: PopulationState) -> Scene:
    stays = np.ones(part.count, np.bool_) if state.away is None else ~state.away
    gone = np.flatnonzero(~stays)
    if not state.born:
        row_delta, newborn = RowDelta(part.count, gone, np.empty(0, np.intp)), None
    else:
        # A single agent returns `self.string + child`, so a later newborn stands before an earlier
        # one. The sort by parents is stable and keeps that order.
        births = sorted(state.born, key=_later_first)
        parents = np.concatenate([birth.rows for birth in births])
        order = np.argsort(parents, kind="stable")
        # A newborn's row: the remaining agents up to its parent, and the newborns before it.
        ahead = np.cumsum(stays)[parents[order]]
        row_delta = RowDelta(part.count, gone, ahead + np.arange(len(order)))
        newborn = Columns.concatenated([birth.newborn for birth in births]).take(order)
    return Scene((part.updated(row_delta, newborn),)) if row_delta.after else EMPTY


def _later_first(birth: Birth) -> int:
    """Sort key: newborns of a later event are closer to their parent."""
    return -birth.turn


def _in_pieces(part: Columns, state: PopulationState, lives: Mapping[int, Scene]) -> Scene:
    made: list[Piece] = []
    young: dict[int, list[Piece]] = {}
    for birth in sorted(state.born, key=_later_first):
        for row, node in zip(birth.rows.tolist(), birth.newborn.nodes(), strict=True):
            young.setdefault(row, []).append(node)
    away = set(np.flatnonzero(state.away).tolist()) if state.away is not None else set[int]()
    begin = 0
    for row in sorted(away | young.keys()):
        # A parent that stays belongs to the piece before its newborns; one that has left does not.
        end = row if row in away else row + 1
        if end > begin:
            made.append(part.take(slice(begin, end)))
        if row in lives:
            made += lives[row].pieces
        made += young.get(row, ())
        begin = row + 1
    if begin < part.count:
        made.append(part.take(slice(begin, part.count)))
    return Scene(tuple(made)) if made else EMPTY


def emissions(
    batches: Sequence[tuple[Rows, Emitted]], single: Sequence[tuple[int, Sequence[Event]]]
) -> tuple[AnyEvent, ...]:
    """Emitted events by type, in the order of their senders' rows and then of emission."""
    chunks: dict[str, list[tuple[Rows, Emitted]]] = {}
    for rows, events in batches:
        event_type = events.type if isinstance(events, Events) else events[0].type
        chunks.setdefault(event_type, []).append((rows, events))
    singles: dict[str, list[tuple[int, Event]]] = {}
    for row, events in single:
        for event in events:
            singles.setdefault(event.type, []).append((row, event))
    emitted: list[AnyEvent] = []
    for event_type in sorted(chunks.keys() | singles.keys()):
        emitted += _ordered(chunks.get(event_type, []), singles.get(event_type, []))
    return tuple(emitted)


def _ordered(
    chunks: list[tuple[Rows, Emitted]], singles: list[tuple[int, Event]]
) -> Sequence[AnyEvent]:
    batches = [events for _, events in chunks if isinstance(events, Events)]
    complete = len(batches) == len(chunks) and not singles
    batch = Events.concatenated(batches) if complete else None
    if batch is None:
        pairs = [
            pair for rows, events in chunks for pair in zip(rows.tolist(), events, strict=True)
        ]
        events = [event for _, event in sorted([*pairs, *singles], key=_row)]
        batch = Events.of(events) if singles else None
        return events if batch is None else [batch]
    rows: NDArray[Any] = np.concatenate([chunk for chunk, _ in chunks])
    # Several methods have sent events of this type; a stable sort keeps the order of each sender.
    if (rows[1:] < rows[:-1]).any():
        return [batch.take(np.argsort(rows, kind="stable"))]
    return [batch]


def _row(pair: tuple[int, Event]) -> int:
    return pair[0]
