"""Evaluates expressions in each frame, and passes rows to the writers of its tables.

Row t of a table of agents or frames is about w_t, the string with which frame t begins: frame 0 has
the initial string, and a run of 300 frames has the rows 0 to 300. Events are those of frame t; of
frame 300 there are those that agents and norms sent in frame 299.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.data_tables import Data, DataTable, Gathered, Writer
from minerva_bus.collect.plans import TablePlan, condition_of, fields_of, plans_of, series_of
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.columns import NUMPY_TYPES, Columns
from minerva_bus.grammar.events import AnyEvent, Event, Events
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import AgentNode, FigureNode, Scene, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.expressions import Expression, data
from minerva_bus.world.operator import CollectedSeries

# --- agents of a string and events of a frame as columns, without an object for each ---


class Rows:
    """Columns of `count` agents or events, created on demand."""

    def __init__(self, fields: Fields, parts: Sequence[Columns | Events | list[Any]]) -> None:
        self._fields = fields
        self._parts = parts
        self.count = sum([len(p) if isinstance(p, list) else p.count for p in parts])

    def column(self, name: str) -> NDArray[Any]:
        """The values of an attribute or datum, shape (count,)."""
        at = self._fields.names.index(name)
        dtype = NUMPY_TYPES[self._fields.all[at].type.kind]
        return _joined([_values(part, name, at, dtype) for part in self._parts], dtype)

    def ids(self) -> Data:
        """The ids of agents."""
        return self._texts("ids", lambda node: node.id)

    def senders(self) -> Data:
        """The senders of events; "" for those of generators."""
        return self._texts("senders", lambda event: event.sender)

    def receivers(self) -> Data:
        """The receivers of events, separated by blanks; "": all that subscribe."""
        return self._texts("receivers", lambda event: " ".join(event.receivers))

    def _texts(self, column: str, text_of: Callable[[Any], str]) -> Data:
        """The column of ids of each part; of single nodes or events, their texts."""
        made: list[Ids | list[str]] = []
        for part in self._parts:
            if isinstance(part, list):
                made.append(list(map(text_of, part)))
            else:
                ids: Ids | None = getattr(part, column)
                made.append([""] * part.count if ids is None else ids)
        if len(made) == 1 and isinstance(made[0], Ids):
            # Ids are spelled only if a writer needs texts.
            return made[0]
        return _array([text for texts in made for text in texts], object)


def agent_rows(scene: Scene, kind: str, fields: Fields) -> Rows:
    """The agents of a kind in a string, including those within others, in its order."""
    parts: list[Columns | Events | list[Any]] = []
    _gather(scene, kind, parts)
    return Rows(fields, parts)


def _gather(scene: Scene, kind: str, parts: list[Columns | Events | list[Any]]) -> None:
    # Strings may be nested as deep as memory goes, so this does not recurse.
    stack = list(reversed(scene.pieces))
    while stack:
        piece = stack.pop()
        if isinstance(piece, Columns):
            if piece.ids is not None and piece.symbol == kind:
                parts.append(piece)
            continue
        # These contain no agents.
        if isinstance(piece, FigureNode) or (isinstance(piece, TransformationNode) and piece.still):
            continue
        if isinstance(piece, AgentNode) and piece.symbol == kind:
            # Neighbouring nodes form one part, so that columns and nodes stay in their order.
            if parts and isinstance(parts[-1], list):
                parts[-1].append(piece)
            else:
                parts.append([piece])
        if piece.scope.pieces:
            stack += reversed(piece.scope.pieces)


def event_rows(events: Iterable[AnyEvent], event_type: str, fields: Fields) -> Rows:
    """The events of a type, in their order."""
    parts: list[Columns | Events | list[Any]] = []
    for event in events:
        if event.type != event_type:
            continue
        if isinstance(event, Events):
            parts.append(event)
        elif parts and isinstance(parts[-1], list):
            parts[-1].append(event)
        else:
            parts.append([event])
    return Rows(fields, parts)


def _values(part: Columns | Events | list[Any], name: str, at: int, dtype: Any) -> NDArray[Any]:
    if isinstance(part, Columns):
        return part.column(name)
    if isinstance(part, Events):
        return part.data(name)
    nodes: list[AgentNode | Event] = part
    return _array([node.values[at] for node in nodes], dtype)


def _array(values: Sequence[Any], dtype: Any) -> NDArray[Any]:
    if dtype is not object:
        return np.array(values, dtype)
    made = np.empty(len(values), object)
    made[:] = values
    return made


def _joined(arrays: Sequence[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    if len(arrays) == 1:
        return arrays[0]
    return np.concatenate([np.empty(0, dtype), *arrays]) if arrays else np.empty(0, dtype)


# --- tables ---

NAN: Final = float("nan")


class Collector:
    """Collects expressions of a run into tables.

    Args:
        plans: the tables, such as those from `plans_of`.
        vocabulary: of the world.
        dt: simulated seconds per frame.
        open_writer: called with the plan of each table, before the first row.
        watch: called with the name of a table of frames and each row of it.

    Raises VocabularyError and MisuseError for an expression that the vocabulary does not allow.

    """

    def __init__(
        self,
        plans: Iterable[TablePlan],
        vocabulary: Vocabulary,
        dt: float,
        open_writer: Callable[[TablePlan], Writer],
        watch: Callable[[str, Mapping[str, Any]], None] = lambda _table, _row: None,
    ) -> None:
        self._vocabulary = vocabulary
        self._dt = dt
        self._watch = watch
        self._tables = [(plan, open_writer(plan)) for plan in plans]
        self._conditions = {
            entry.condition: condition_of(entry, vocabulary)
            for plan, _ in self._tables
            for entry in plan.expressions
        }
        # Rows of frame tables, which are complete only when the frame's events are known.
        self._pending: dict[str, dict[str, Any]] = {}
        self._frame = 0

    def begin(self, frame: int, scene: Scene) -> None:
        """Collect data of the string with which a frame begins."""
        self.drop_unfinished()
        self._frame = frame
        # Expressions about the same agents share their columns within a frame.
        known: dict[str, Rows] = {}
        for plan, writer in self._tables:
            if frame % plan.interval:
                continue
            # Aggregates of events are added at the end of the frame.
            if not plan.symbol:
                row: dict[str, Any] = {"frame": frame, "time": frame * self._dt}
                for name, entry in plan.entries.items():
                    if not entry.of_events:
                        rows = self._rows(agent_rows, scene, entry.symbol, known)
                        row |= self._aggregated(name, entry, rows)
                self._pending[plan.name] = row
            elif plan.symbol[0] == "A":
                self._write(plan, writer, frame, self._rows(agent_rows, scene, plan.symbol, known))

    def done(self, frame: int, events: Iterable[AnyEvent], scene: Scene) -> None:
        """Collect data of a frame's events, and of the string with which the next frame begins."""
        self.end(frame, events)
        self.begin(frame + 1, scene)

    def close(self, events: Iterable[AnyEvent]) -> None:
        """Finish all tables; no frame follows the last string, and these are its `events`."""
        self.end(self._frame, events)
        for _, writer in self._tables:
            writer.close()

    def drop_unfinished(self) -> None:
        """Finish the rows of a frame whose events are missing in a record."""
        for plan, writer in self._tables:
            row = self._pending.pop(plan.name, None)
            # A number of events would be wrong: how many there were is unknown.
            if row is not None and not any(entry.of_events for entry in plan.entries.values()):
                self._end_row(plan, writer, row)

    def end(self, frame: int, events: Iterable[AnyEvent]) -> None:
        """Collect data of a frame's events."""
        events = tuple(events)
        if frame != self._frame:
            self.drop_unfinished()
        known: dict[str, Rows] = {}
        for plan, writer in self._tables:
            if plan.symbol[:1] == "e" and not frame % plan.interval:
                self._write(plan, writer, frame, self._rows(event_rows, events, plan.symbol, known))
            row = self._pending.pop(plan.name, None)
            if row is None:
                continue
            for name, entry in plan.entries.items():
                if entry.of_events:
                    rows = self._rows(event_rows, events, entry.symbol, known)
                    row |= self._aggregated(name, entry, rows)
            self._end_row(plan, writer, row)

    def _end_row(self, plan: TablePlan, writer: Writer, row: dict[str, Any]) -> None:
        self._watch(plan.name, row)
        writer.row(row)

    def _rows(
        self,
        make: Callable[[Any, str, Fields], Rows],
        source: Scene | tuple[AnyEvent, ...],
        symbol: str,
        known: dict[str, Rows],
    ) -> Rows:
        """The agents of a kind in a string, or the events of a type, once in a frame."""
        if symbol not in known:
            known[symbol] = make(source, symbol, fields_of(self._vocabulary, symbol))
        return known[symbol]

    def _chosen(self, condition: str, rows: Rows) -> NDArray[np.bool_] | None:
        """The rows that fulfil a condition; None: all."""
        read = self._conditions[condition]
        if read.term is None or not rows.count:
            return None
        # Only the columns that the condition names.
        state = {name: rows.column(name) for name in read.names}
        return read.holds_of_many(state, rows.count)

    def _write(self, plan: TablePlan, writer: Writer, frame: int, rows: Rows) -> None:
        if not rows.count:
            return
        chosen = self._chosen(plan.condition, rows)
        made: dict[str, Data] = {"frame": np.full(rows.count, frame, np.int64)}
        if plan.symbol[0] == "A":
            made["id"] = rows.ids()
        else:
            made |= {"sender": rows.senders(), "receiver": rows.receivers()}
        made |= {column: rows.column(name) for column, name in plan.names.items()}
        # Selected at the end: ids, numbers and texts by the same rows.
        if chosen is not None and not chosen.all():
            where = np.flatnonzero(chosen)
            made = {
                column: data.take(where) if isinstance(data, Ids) else data[where]
                for column, data in made.items()
            }
        writer.rows(made)

    def _aggregated(self, name: str, entry: Expression, rows: Rows) -> dict[str, Any]:
        """The columns of an expression in one frame."""
        chosen = self._chosen(entry.condition, rows)
        if entry.function == "count":
            return {name: rows.count if chosen is None else int(chosen.sum())}
        values = rows.column(entry.name)
        if chosen is not None:
            values = values[chosen]
        if entry.function == "quantiles":
            levels = entry.arguments
            numbers = np.quantile(values, levels).tolist() if len(values) else [NAN] * len(levels)
            return {f"{name}_{n:g}": number for n, number in zip(levels, numbers, strict=True)}
        if entry.function == "histogram":
            low, high, bins = entry.arguments
            counts = np.histogram(values, int(bins), (low, high))[0].tolist()
            return {f"{name}_{number}": count for number, count in enumerate(counts)}
        if entry.function == "sum":
            return {name: values.sum().item()}
        # numpy raises an error for the minimum of no values, and warns for their mean.
        return {name: float(getattr(values, entry.function)()) if len(values) else NAN}


def agents_now(
    scene: Scene, vocabulary: Vocabulary, kind: Any, where: str, frame: int
) -> DataTable:
    """The agents of a kind in the string with which a frame begins; see `Live.agents`."""
    selected = data(kind).where(where)
    (plan,) = plans_of({selected.symbol: selected}, vocabulary, "agents of")
    if selected.of_events:
        raise MisuseError(f"{plan.symbol} is an event type; expected an agent class")
    gathered = Gathered(plan.name, plan.columns)
    Collector([plan], vocabulary, 0.0, lambda _: gathered).begin(frame, scene)
    return gathered.table


# --- the last values of collected series, for dashboards of a running world ---

MAX_SERIES: Final = 16
"""Series of a run that dashboards show: the first ones."""

MAX_POINTS: Final = 240
"""Values kept of each series; of more, every second one is dropped again and again."""


class SeriesHistory:
    """Keeps values of the series of a run, evenly spaced over all its frames.

    At most MAX_SERIES series with MAX_POINTS values each, so an answer has a bounded size.
    """

    def __init__(self, plans: Sequence[TablePlan], vocabulary: Vocabulary) -> None:
        self._units: dict[str, dict[str, str]] = {}
        left = MAX_SERIES
        for plan in plans:
            units = dict([*series_of(plan, vocabulary).items()][:left])
            left -= len(units)
            if units:
                self._units[plan.name] = units
        self._kept: dict[str, list[Mapping[str, Any]]] = {name: [] for name in self._units}
        self._last: dict[str, Mapping[str, Any]] = {}
        self._strides = dict.fromkeys(self._units, 1)
        self._counts = dict.fromkeys(self._units, 0)

    def __len__(self) -> int:
        return sum(map(len, self._units.values()))

    def add(self, table: str, row: Mapping[str, Any]) -> None:
        """Keep the values of a row, if its table has series."""
        if table not in self._kept:
            return
        kept = self._kept[table]
        self._last[table] = row
        if self._counts[table] % self._strides[table] == 0:
            kept.append(row)
        self._counts[table] += 1
        # One value less than the limit, because the last one is always shown.
        if len(kept) >= MAX_POINTS:
            del kept[1::2]
            self._strides[table] *= 2

    def series(self) -> tuple[CollectedSeries, ...]:
        """The series, in the order of their expressions."""
        made: list[CollectedSeries] = []
        for table, units in self._units.items():
            rows = self._kept[table]
            last = self._last.get(table)
            if last is not None and last is not rows[-1]:
                rows = [*rows, last]
            frames = tuple([int(row["frame"]) for row in rows])
            made += [
                CollectedSeries(name, unit, frames, tuple([float(row[name]) for row in rows]))
                for name, unit in units.items()
            ]
        return tuple(made)
