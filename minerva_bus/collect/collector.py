"""Evaluates expressions in each frame, and passes rows to the writers of its tables.

Row t of a table of agents or frames is about w_t, the string with which frame t begins: frame 0 has
the initial string, and a run of 300 frames has the rows 0 to 300. Events are those of frame t.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.rows import Data, Rows, agent_rows, event_rows
from minerva_bus.collect.writers import Writer
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.fields import Fields
from minerva_bus.grammar.ids import Ids
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.expressions import Expression, read_expression

FRAMES: Final = "frames"
NAN: Final = float("nan")
_OWN: Final = {"A": ("frame", "id"), "e": ("frame", "sender", "receiver")}

Entries: TypeAlias = Mapping[str, Expression]


@dataclass(slots=True)
class TablePlan:
    """One table: its rows are about a kind of agents, a type of events, or the frames.

    `columns` are the types of its columns (float64, int64, bool or text) by name. `names` are the
    attributes by column, `entries` the expressions by column for a table of frames.
    """

    name: str
    interval: int
    columns: dict[str, str]
    symbol: str = ""
    condition: str = ""
    names: dict[str, str] = field(default_factory=dict[str, str])
    entries: dict[str, Expression] = field(default_factory=dict[str, Expression])


def read_entries(given: object) -> dict[str, Expression]:
    """The expressions to collect, by name, from a mapping or from a list of attributes.

    Values are expressions or their texts. Raises MisuseError and VocabularyError.
    """
    pairs: list[tuple[str, object]]
    if isinstance(given, Mapping):
        named = cast("Mapping[object, object]", given)
        pairs = [(str(name), value) for name, value in named.items()]
    elif isinstance(given, list | tuple):
        listed = cast("Iterable[object]", given)
        # A list gives no names, so the attributes name the columns.
        expressions = [_expression(value, "collect") for value in listed]
        pairs = [(expression.name or expression.symbol, expression) for expression in expressions]
    else:
        raise MisuseError(f"collect: expected names with expressions, not {given!r:.60}")
    entries: dict[str, Expression] = {}
    for name, value in pairs:
        if not name or name in entries:
            raise MisuseError(f"collect: the name {name!r} is given twice, or is empty")
        entries[name] = _expression(value, f"collect: {name}")
    return entries


def _expression(value: object, source: str) -> Expression:
    if isinstance(value, Expression):
        return value
    if isinstance(value, str):
        return read_expression(value, source)
    raise MisuseError(
        f"{source}: expected an expression such as Person.x or count(Person), not {value!r:.60}"
    )


def plans_of(entries: Entries, vocabulary: Vocabulary) -> list[TablePlan]:
    """The tables for these expressions. Raises VocabularyError and MisuseError."""
    plans: dict[tuple[Any, ...], TablePlan] = {}
    taken: set[str] = set()
    for name, entry in entries.items():
        entry.checked(vocabulary, f"collect: {name}")
        about = FRAMES if entry.function else entry.symbol
        # Aggregates select rows column by column, so they share a table whatever their conditions
        # are.
        key = (about, entry.condition if not entry.function else "", entry.interval)
        # One table for each kind of rows: the same agents or events, in the same frames.
        plan = plans.get(key)
        if plan is None:
            plan = plans[key] = _plan(_table_name(about, entry, name, taken), about, entry)
            taken.add(plan.name)
        fields = _fields(vocabulary, entry.symbol)
        for column, kind in _columns(name, entry, fields):
            if column in plan.columns:
                raise MisuseError(
                    f"collect: the table {plan.name} has two columns {column!r}; rename {name}"
                )
            plan.columns[column] = kind
        if entry.function:
            plan.entries[name] = entry
        else:
            names = [entry.name] if entry.name else fields.names
            plan.names |= {name if entry.name else each: each for each in names}
    return list(plans.values())


def _table_name(about: str, entry: Expression, name: str, taken: set[str]) -> str:
    if about not in taken:
        return about
    return f"{about}_every_{entry.interval}" if about == FRAMES else f"{about}_{name}"


def _plan(name: str, about: str, entry: Expression) -> TablePlan:
    if about == FRAMES:
        return TablePlan(name, entry.interval, {"frame": "int64", "time": "float64"})
    own = dict.fromkeys(_OWN[about[0]], "text") | {"frame": "int64"}
    return TablePlan(name, entry.interval, own, about, entry.condition)


_TYPES: Final = {"real": "float64", "int": "int64", "bool": "bool", "text": "text"}


def _fields(vocabulary: Vocabulary, symbol: str) -> Fields:
    known: Mapping[str, Any] = vocabulary.events if symbol[0] == "e" else vocabulary.kinds
    return known[symbol].fields


def _columns(name: str, entry: Expression, fields: Fields) -> list[tuple[str, str]]:
    """The columns of an expression, with their types."""
    types = {field.name: field.type.kind for field in fields.all}
    function = entry.function
    if not function:
        return [(name, _TYPES[types[entry.name]])] if entry.name else _data_columns(entry, types)
    if function == "quantiles":
        return [(f"{name}_{number:g}", "float64") for number in entry.arguments]
    if function == "histogram":
        return [(f"{name}_{number}", "int64") for number in range(int(entry.arguments[2]))]
    whole = function == "count" or (function == "sum" and types[entry.name] in ("int", "bool"))
    return [(name, "int64" if whole else "float64")]


def _data_columns(entry: Expression, types: Mapping[str, str]) -> list[tuple[str, str]]:
    for name, kind in types.items():
        if kind not in _TYPES:
            raise MisuseError(f"collect: {entry.symbol}.{name} is no number, truth or text; name"
                              f" the data to collect: data({entry.symbol}, NAME)")  # fmt: skip
    return [(name, _TYPES[kind]) for name, kind in types.items()]


class Collector:
    """Collects expressions of a run into tables.

    Args:
        entries: expressions by name.
        vocabulary: of the world.
        dt: simulated seconds per frame.
        open_writer: called with the plan of each table, before the first row.

    Raises VocabularyError and MisuseError for an expression that the vocabulary does not allow.

    """

    def __init__(
        self,
        entries: Entries,
        vocabulary: Vocabulary,
        dt: float,
        open_writer: Callable[[TablePlan], Writer],
    ) -> None:
        self._vocabulary = vocabulary
        self._dt = dt
        self._conditions = {
            entry.condition: entry.checked(vocabulary) for entry in entries.values()
        }
        self.plans = plans_of(entries, vocabulary)
        self._tables = [(plan, open_writer(plan)) for plan in self.plans]
        # Rows of frame tables, which are complete only when the frame's events are known.
        self._pending: dict[str, dict[str, Any]] = {}
        self._frame = 0

    def begin(self, frame: int, scene: Scene) -> None:
        """Collect data of the string with which a frame begins."""
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
                        rows = self._agents(scene, entry.symbol, known)
                        row |= self._aggregated(name, entry, rows)
                self._pending[plan.name] = row
            elif plan.symbol[0] == "A":
                self._write(plan, writer, frame, self._agents(scene, plan.symbol, known))

    def done(self, frame: int, events: Iterable[AnyEvent], scene: Scene) -> None:
        """Collect data of a frame's events, and of the string with which the next frame begins."""
        self._end(frame, tuple(events))
        self.begin(frame + 1, scene)

    def close(self) -> None:
        """Finish all tables."""
        # The last string has no frame after it; its row counts no events.
        self._end(self._frame, ())
        for _, writer in self._tables:
            writer.close()

    def _end(self, frame: int, events: tuple[AnyEvent, ...]) -> None:
        known: dict[str, Rows] = {}
        for plan, writer in self._tables:
            if plan.symbol[:1] == "e" and not frame % plan.interval:
                self._write(plan, writer, frame, self._events(events, plan.symbol, known))
            row = self._pending.pop(plan.name, None)
            if row is None:
                continue
            for name, entry in plan.entries.items():
                if entry.of_events:
                    rows = self._events(events, entry.symbol, known)
                    row |= self._aggregated(name, entry, rows)
            writer.row(row)

    def _agents(self, scene: Scene, kind: str, known: dict[str, Rows]) -> Rows:
        if kind not in known:
            known[kind] = agent_rows(scene, kind, _fields(self._vocabulary, kind))
        return known[kind]

    def _events(self, events: tuple[AnyEvent, ...], symbol: str, known: dict[str, Rows]) -> Rows:
        if symbol not in known:
            known[symbol] = event_rows(events, symbol, _fields(self._vocabulary, symbol))
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
