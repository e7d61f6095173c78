"""A table of collected data: columns that any library for tables can read."""

from __future__ import annotations

import html
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.arguments import path_of, text, text_list
from minerva_bus.collect.rows import DTYPES, Data
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.grammar.ids import Ids
from minerva_bus.wording import counted, install

if TYPE_CHECKING:
    from minerva_bus.plotting import Plot

ARRAY_TYPES: Final = {
    "float64": DTYPES["real"], "int64": DTYPES["int"], "bool": DTYPES["bool"],
    "text": DTYPES["text"],
}  # fmt: skip
SHOWN_ROWS: Final = 10
SEED: Final = "seed"
"""The column of a sweep's table that distinguishes runs of the same options."""


def texts(data: Data) -> NDArray[Any]:
    """A column as an array; ids become texts."""
    return data.column if isinstance(data, Ids) else data


class DataTable:
    """Columns of equal length, by name.

    Args:
        name: of the table.
        types: float64, int64, bool or text, by column.
        columns: arrays of shape (rows,), by column.

    With pyarrow installed, it has Arrow's stream interface, so `pyarrow.table(table)`,
    `polars.DataFrame(table)` and DuckDB read it without a copy of its numbers.

    """

    def __init__(
        self, name: str, types: Mapping[str, str], columns: Mapping[str, NDArray[Any]]
    ) -> None:
        self.name = name
        self.types = dict(types)
        self._columns = {column: columns[column] for column in types}

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(self.types)

    def __len__(self) -> int:
        return len(next(iter(self._columns.values()), ()))

    def __getitem__(self, column: str) -> NDArray[Any]:
        """The values of a column, shape (rows,). Raises MisuseError for an unknown one."""
        if text("a column", column) not in self._columns:
            hint = nearest(column, [*self.columns], f"it has {', '.join(self.columns)}")
            raise MisuseError(f"the table {self.name} has no column {column!r}{hint}")
        return self._columns[column]

    def rows(self) -> Iterator[tuple[Any, ...]]:
        """The rows, as tuples of Python values."""
        return zip(*[column.tolist() for column in self._columns.values()], strict=True)

    def __repr__(self) -> str:
        lines = self._lines()
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        shown = ["  ".join(map(str.rjust, line, widths)) for line in lines]
        return "\n".join([*shown, *self._more()])

    def _repr_html_(self) -> str:
        head, *rows = [[html.escape(cell) for cell in line] for line in self._lines()]
        top = "".join(f"<th>{cell}</th>" for cell in head)
        body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
        more = "".join(f"<p>{line}</p>" for line in self._more())
        return f"<div><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>{more}</div>"

    def _lines(self) -> list[list[str]]:
        """The names of the columns, and the first rows."""
        return [
            [_shown(value) for value in line]
            for line in (self.columns, *islice(self.rows(), SHOWN_ROWS))
        ]

    def _more(self) -> list[str]:
        more = len(self) - SHOWN_ROWS
        return [f"and {counted(more, 'more row')}"] if more > 0 else []

    def plot(self, *series: str, x: str = "", bars: bool = False) -> Plot:
        """A plot of its columns, which notebooks display; needs the extra `plot`.

        A line is the mean of all rows with the same x, such as those of several seeds or agents; a
        band has the middle 80 % of them. Options of a sweep have a line each.

        Args:
            series: columns, or names of histograms; none: all.
            x: the column along the axis; "": `time` in s, `frame`, or the first with numbers.
            bars: histograms of the last frame, not over time.

        Raises MisuseError if there is nothing to plot, and without matplotlib, with the command
        that installs it.

        Example:
            `run.table().plot("sick")`, `run.table().plot().save("run.svg")`

        """
        # Plots import this module.
        from minerva_bus.collect.series_plot import PlotOptions, plot_table

        return plot_table(self, PlotOptions(text("x", x), text_list("series", series), bars=bars))

    # --- other libraries ---

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The columns as numpy arrays, by name."""
        return dict(self._columns)

    def to_arrow(self) -> Any:
        """A `pyarrow.Table`. Raises MisuseError if pyarrow is not installed."""
        arrow = needed("pyarrow", "parquet")
        # 64-bit offsets, as the texts of one column may have more than 2 GiB.
        kinds = {"float64": arrow.float64(), "int64": arrow.int64(), "bool": arrow.bool_(),
                 "text": arrow.large_string()}  # fmt: skip
        schema = arrow.schema([(name, kinds[kind]) for name, kind in self.types.items()])
        return arrow.table(self._columns, schema=schema)

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame`. Raises MisuseError if pandas is not installed."""
        return needed("pandas", "pandas").DataFrame(self._columns)

    def to_polars(self) -> Any:
        """A `polars.DataFrame`. Raises MisuseError if polars is not installed."""
        polars = needed("polars", "polars")
        # A list, as polars would keep an array of texts as Python objects.
        return polars.DataFrame(
            {
                name: polars.Series(name, column.tolist(), polars.String)
                if self.types[name] == "text"
                else column
                for name, column in self._columns.items()
            }
        )

    def to_csv(self, path: str | Path) -> None:
        """Write a .csv file. Raises MisuseError if it cannot be written."""
        self._write(path_of("path", path))

    def to_parquet(self, path: str | Path) -> None:
        """Write a .parquet file. Raises MisuseError, also if pyarrow is not installed."""
        self._write(path_of("path", path))

    def _write(self, path: Path) -> None:
        # The writers import this module.
        from minerva_bus.collect.writers import open_writer

        writer = open_writer(path, self.name, self.types)
        writer.rows(self._columns)
        writer.close()


class Gathered:
    """Rows of one table in memory, in order of arrival."""

    def __init__(self, name: str, types: Mapping[str, str]) -> None:
        self._name = name
        self._types = types
        self._chunks: list[Mapping[str, Data]] = []
        self._single: list[Mapping[str, Any]] = []

    def row(self, values: Mapping[str, Any]) -> None:
        """Add one row."""
        self._single.append(values)

    def rows(self, columns: Mapping[str, Data]) -> None:
        """Add rows as columns of equal length."""
        self._chunks.append(columns)

    def close(self) -> None:
        """Do nothing: there is no file."""

    @property
    def table(self) -> DataTable:
        """All rows so far."""
        if self._single:
            self._chunks.append(columns_of(self._single, self._types))
            self._single = []
        made = {
            # The empty array gives the type if there are no rows.
            column: np.concatenate(
                [np.empty(0, ARRAY_TYPES[kind]), *[texts(chunk[column]) for chunk in self._chunks]]
            )
            for column, kind in self._types.items()
        }
        return DataTable(self._name, self._types, made)


def columns_of(rows: list[Mapping[str, Any]], types: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """Single rows as columns."""
    made: dict[str, NDArray[Any]] = {}
    for column, kind in types.items():
        made[column] = np.empty(len(rows), ARRAY_TYPES[kind])
        # Assigned, because numpy would make texts an array of fixed width.
        made[column][:] = [row[column] for row in rows]
    return made


def typed_column(
    values: Sequence[Any], text: Callable[[Any], str] = str
) -> tuple[str, NDArray[Any]]:
    """The type of plain values, and an array of them: bool, int64, float64, or otherwise text.

    Args:
        values: a missing value is None; it becomes nan among numbers, else "".
        text: writes a value of a column of texts.

    """
    kind = _type_of(values)
    made = np.empty(len(values), ARRAY_TYPES[kind])
    if kind == "float64":
        values = [np.nan if value is None else float(value) for value in values]
    elif kind == "text":
        values = ["" if value is None else text(value) for value in values]
    made[:] = values
    return kind, made


def _type_of(values: Sequence[Any]) -> str:
    kinds: set[type[Any]] = {type(value) for value in values}
    if kinds == {bool}:
        return "bool"
    if not kinds & {int, float} or not kinds <= {int, float, type(None)}:
        return "text"
    largest = max([abs(value) for value in values if type(value) is int], default=0)
    if kinds == {int} and largest < 1 << 63:
        return "int64"
    return "float64" if largest <= sys.float_info.max else "text"


def needed(library: str, extra: str) -> Any:
    """A library of an extra. Raises MisuseError with the command that installs it."""
    try:
        return import_module(library)
    except ImportError:
        raise MisuseError(f"this needs {library}: {install(extra)}") from None


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
