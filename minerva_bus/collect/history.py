"""The last values of collected series, in bounded memory, for dashboards of a running world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from minerva_bus.collect.plans import TablePlan, series_of
from minerva_bus.collect.rows import Data
from minerva_bus.collect.writers import Writer
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import CollectedSeries

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

    def watched(self, plan: TablePlan, writer: Writer) -> Writer:
        """A writer that also passes the rows of a table to this history, if it has series."""
        return _Watched(self, plan.name, writer) if plan.name in self._units else writer

    def add(self, table: str, row: Mapping[str, Any]) -> None:
        """Keep the values of a row."""
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


class _Watched:
    """Passes rows on to a writer and to the history."""

    def __init__(self, history: SeriesHistory, table: str, writer: Writer) -> None:
        self._history = history
        self._table = table
        self._writer = writer

    def row(self, values: Mapping[str, Any]) -> None:
        self._history.add(self._table, values)
        self._writer.row(values)

    def rows(self, columns: Mapping[str, Data]) -> None:
        self._writer.rows(columns)

    def close(self) -> None:
        self._writer.close()
