"""The table of a study's runs: .csv, or .parquet with the extra `sweep`.

One row for each combination, in their order: the options, what the run came to, and last what
is never twice the same, the seconds it took.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import MisuseError
from minerva_bus.launch.resuming import option_text
from minerva_bus.launch.typed import toml_value
from minerva_bus.outputs import replacing
from minerva_bus.study.grid import Combination

ENDINGS: Final = (".csv", ".parquet")
OWN: Final = ("frames", "digest", "ended", "reached")
LAST: Final = ("error", "seconds")


@dataclass(frozen=True, slots=True)
class Row:
    """A run of one combination: what it came to, or why it failed."""

    combination: Combination
    outcome: Mapping[str, Any] = field(default_factory=dict[str, Any])
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
    error: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under the names of their columns; None where a run has no such value."""

    keys: tuple[str, ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    @staticmethod
    def of(keys: Sequence[str], rows: Sequence[Row]) -> Table:
        """The table of some runs; an option or figure named like another column has a `_`."""
        figures = sorted({name for row in rows for name in row.figures})
        taken = {*OWN, *LAST}
        named = [f"{key}_" if key in taken else key for key in keys]
        taken |= set(named)
        shown = [f"{name}_" if name in taken else name for name in figures]
        columns = (*named, *OWN, *shown, *LAST)
        return Table(tuple(named), columns, tuple([_cells(row, figures) for row in rows]))

    def column(self, name: str) -> list[Any]:
        """The values of a column."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]

    @property
    def measures(self) -> list[str]:
        """The columns of results that are numbers: frames and figures."""
        names = [one for one in self.columns if one not in (*self.keys, "seconds")]
        return [one for one in names if _numeric(self.column(one))]


def _cells(row: Row, figures: Sequence[str]) -> tuple[Any, ...]:
    return (
        *map(_option, row.combination),
        *[row.outcome.get(name) for name in OWN],
        *[row.figures.get(name) for name in figures],
        row.error or None,
        round(row.seconds, 3),
    )


def _option(text: str) -> Any:
    """An option's value as a number or a truth, if it is one, or else as it was given."""
    value = toml_value(text)
    return value if _is_number(value) else text


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _numeric(values: Sequence[Any]) -> bool:
    known = [one for one in values if one is not None]
    numbers = all(_is_number(one) and not isinstance(one, bool) for one in known)
    return bool(known) and numbers


def check_table(path: Path) -> None:
    """Raises MisuseError where no table can be written into a file of this name."""
    if path.suffix not in ENDINGS:
        raise MisuseError(f"{path}: a table is {' or '.join(ENDINGS)}")
    if not path.parent.is_dir():
        raise MisuseError(f"{path}: there is no folder {path.parent}")
    if path.suffix == ".parquet":
        from importlib.util import find_spec

        if find_spec("pyarrow") is None:
            raise MisuseError("parquet needs pyarrow: pip install 'minerva-bus[sweep]'")


def write(table: Table, path: Path) -> None:
    """Write a table, all of it or nothing. Raises MisuseError."""
    data = _csv(table) if path.suffix == ".csv" else _parquet(table)
    try:
        with replacing(path, durable=True) as file:
            file.write(data)
    except OSError as error:
        raise MisuseError(f"{path}: {error.strerror}") from None


def _csv(table: Table) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([[_cell(one) for one in row] for row in table.rows])
    return text.getvalue().encode()


def _cell(value: Any) -> str:
    return "" if value is None else option_text(value)


def _parquet(table: Table) -> bytes:
    import pyarrow as pa  # pyright: ignore[reportMissingTypeStubs]
    import pyarrow.parquet as pq  # pyright: ignore[reportMissingTypeStubs]

    arrow: Any = pa
    columns = {name: arrow.array(*_typed(table.column(name))) for name in table.columns}
    sink: Any = arrow.BufferOutputStream()
    writer: Any = pq
    writer.write_table(arrow.table(columns), sink)
    return sink.getvalue().to_pybytes()


def _typed(values: list[Any]) -> tuple[list[Any], Any]:
    """Values of one column as one type: whole numbers, numbers, truths, or else texts."""
    import pyarrow as pa  # pyright: ignore[reportMissingTypeStubs]

    arrow: Any = pa
    kinds: set[type[Any]] = {type(one) for one in values if one is not None}
    if kinds == {int} and all(abs(one) < 1 << 63 for one in values if one is not None):
        return values, arrow.int64()
    if kinds == {bool}:
        return values, arrow.bool_()
    if kinds and kinds <= {int, float}:
        return [None if one is None else float(one) for one in values], arrow.float64()
    return [None if one is None else option_text(one) for one in values], arrow.string()
