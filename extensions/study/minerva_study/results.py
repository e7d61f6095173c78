"""The table of a study's runs: .csv, or .parquet with the extra `sweep`.

One row per combination, in their order: the options, the results of the run, and last its
duration, the only column that a repetition changes.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from minerva_bus.collect import data_tables
from minerva_bus.errors import MisuseError
from minerva_bus.files import ending_of, replacing
from minerva_bus.launch.toml_tables import option_text, toml_value
from minerva_bus.wording import install
from minerva_study.grid import Combination

OWN: Final = ("frames", "digest", "ended", "reached")
LAST: Final = ("error", "seconds")


@dataclass(frozen=True, slots=True)
class Row:
    """The run of a combination: its results, or why it failed."""

    combination: Combination
    outcome: Mapping[str, Any] = field(default_factory=dict[str, Any])
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
    error: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class ResultTable:
    """Rows with the names of their columns; None if a run has no such value."""

    keys: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    @staticmethod
    def of(keys: Sequence[str], rows: Sequence[Row]) -> ResultTable:
        """The table of these runs; a name of two columns gets a `_` in the second one."""
        # Runs may report different figures; sorted, so that the columns do not depend on which run
        # is first.
        figures = sorted({name for row in rows for name in row.figures})
        taken = {*OWN, *LAST}
        named = [f"{key}_" if key in taken else key for key in keys]
        taken |= set(named)
        shown = [f"{name}_" if name in taken else name for name in figures]
        columns = (*named, *OWN, *shown, *LAST)
        return ResultTable(tuple(named), columns, tuple([_cells(row, figures) for row in rows]))

    def column(self, name: str) -> list[Any]:
        """The values of a column."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]

    @property
    def measures(self) -> list[str]:
        """The result columns with numbers: frames and figures."""
        names = [name for name in self.columns if name not in (*self.keys, "seconds")]
        return [name for name in names if _numeric(self.column(name))]


def _cells(row: Row, figures: Sequence[str]) -> tuple[Any, ...]:
    return (
        *map(option_value, row.combination),
        *[row.outcome.get(name) for name in OWN],
        *[row.figures.get(name) for name in figures],
        row.error or None,
        round(row.seconds, 3),
    )


def option_value(text: str) -> Any:
    """An option's value as a number or a bool if it is one, otherwise as text."""
    value = toml_value(text)
    return value if isinstance(value, int | float) else text


def _numeric(values: Sequence[Any]) -> bool:
    known: set[type[Any]] = {type(value) for value in values if value is not None}
    return bool(known) and known <= {int, float}


def check_table(path: Path) -> None:
    """Check that a table can be written to this file. Raises MisuseError."""
    data_tables.check_table(path)
    if ending_of(path) == ".parquet":
        from importlib.util import find_spec

        if find_spec("pyarrow") is None:
            raise MisuseError(f"parquet needs pyarrow: {install('sweep')}")


def write(table: ResultTable, path: Path) -> None:
    """Write a table, completely or not at all. Raises MisuseError."""
    data = _csv(table) if ending_of(path) == ".csv" else _parquet(table)
    try:
        with replacing(path, durable=True) as file:
            file.write(data)
    except OSError as error:
        raise MisuseError(f"{path}: {error.strerror}") from None


def _csv(table: ResultTable) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([[_cell(value) for value in row] for row in table.rows])
    return text.getvalue().encode()


def _cell(value: Any) -> str:
    return "" if value is None else option_text(value)


def _parquet(table: ResultTable) -> bytes:
    import pyarrow as pa  # pyright: ignore[reportMissingTypeStubs]
    import pyarrow.parquet as pq  # pyright: ignore[reportMissingTypeStubs]

    arrow: Any = pa
    # Types are given, because pyarrow would derive them from the values and fail at a mixture.
    columns = {name: arrow.array(*_typed(table.column(name))) for name in table.columns}
    sink: Any = arrow.BufferOutputStream()
    writer: Any = pq
    writer.write_table(arrow.table(columns), sink)
    return sink.getvalue().to_pybytes()


def _typed(values: list[Any]) -> tuple[list[Any], Any]:
    """The values of a column with one type: integers, floats, bools, or otherwise text."""
    import pyarrow as pa  # pyright: ignore[reportMissingTypeStubs]

    arrow: Any = pa
    kinds: set[type[Any]] = {type(value) for value in values if value is not None}
    largest = max([abs(value) for value in values if type(value) is int], default=0)
    if kinds == {int} and largest < 1 << 63:
        return values, arrow.int64()
    if kinds == {bool}:
        return values, arrow.bool_()
    if kinds and kinds <= {int, float} and largest <= sys.float_info.max:
        return [None if value is None else float(value) for value in values], arrow.float64()
    return [None if value is None else option_text(value) for value in values], arrow.string()
