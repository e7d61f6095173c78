"""Tables of collected data: columns in memory that any library for tables can read, and files.

Files are written in bounded memory while a world runs:

.csv        texts, for any program
.parquet    needs pyarrow
.arrow      needs pyarrow; the parts of a Parquet file, see table_parts.py
.columns    arrays of numpy in sequence: tables for another process, the parts of a .csv file
"""

from __future__ import annotations

import csv
import html
from collections.abc import Iterator, Mapping
from importlib import import_module
from itertools import islice, pairwise
from pathlib import Path
from typing import IO, Any, Final, Protocol, TextIO, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.plans import ENDINGS
from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import MARK, check_ending, check_output, ending_of, reason_of
from minerva_bus.grammar.ids import Ids
from minerva_bus.values import path_of, text, text_list
from minerva_bus.wording import counted, install

Data: TypeAlias = NDArray[Any] | Ids
"""A column; ids are spelled only if a writer needs texts."""

ARRAY_TYPES: Final[Mapping[str, Any]] = {
    "float64": np.float64,
    "int64": np.int64,
    "bool": np.bool_,
    "text": object,
}
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
            [f"{each:.6g}" if isinstance(each, float) else str(each) for each in line]
            for line in (self.columns, *islice(self.rows(), SHOWN_ROWS))
        ]

    def _more(self) -> list[str]:
        more = len(self) - SHOWN_ROWS
        return [f"and {counted(more, 'more row')}"] if more > 0 else []

    def plot(self, *series: str, x: str = "", bars: bool = False) -> Any:
        """A `Plot` of its columns, which notebooks display; needs the extra `plot`.

        A line is the mean of all rows with the same x, such as those of several seeds or agents; a
        band has the middle 80 % of them. Options of a sweep have a line each; along one of them,
        the values are those of the last frame.

        Args:
            series: columns, or names of histograms; none: all.
            x: the column along the axis; "": `frame`, or `time` in s in a world with a `dt` of its
                own; in other tables the first with numbers.
            bars: histograms of the last frame, not over time.

        Raises MisuseError if there is nothing to plot, and without matplotlib, with the command
        that installs it.

        Example:
            `run.table().plot("sick")`, `run.table().plot().save("run.svg")`

        """
        plots = entries("minerva.plots").get("table")
        if plots is None:
            raise MisuseError("plots need the extension analysis, which is not installed")
        return plots.load()(self, text_list("series", series), text("x", x), bars=bars)

    # --- other libraries ---

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """The columns as numpy arrays, by name."""
        return dict(self._columns)

    def to_arrow(self) -> Any:
        """A `pyarrow.Table`. Raises MisuseError if pyarrow is not installed."""
        # 64-bit offsets, as the texts of one column may have more than 2 GiB.
        schema = _arrow_schema(self.types, "large_string")
        return needed("pyarrow", "parquet").table(self._columns, schema=schema)

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
        self._write(path_of("path", path), ".csv")

    def to_parquet(self, path: str | Path) -> None:
        """Write a .parquet file. Raises MisuseError, also if pyarrow is not installed."""
        self._write(path_of("path", path), ".parquet")

    def _write(self, path: Path, ending: str) -> None:
        check_table(path, ending)
        check_output(path, f"the table {self.name}")
        writer = create_writer(path, self.types)
        writer.rows(self._columns)
        writer.close()


class Gathered:
    """Rows of one table in memory, in order of arrival."""

    def __init__(self, name: str, types: Mapping[str, str]) -> None:
        self._name = name
        self.types = types
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
        self._take_single()
        made = {
            # The empty array gives the type if there are no rows.
            column: np.concatenate(
                [np.empty(0, ARRAY_TYPES[kind]), *[texts(chunk[column]) for chunk in self._chunks]]
            )
            for column, kind in self.types.items()
        }
        return DataTable(self._name, self.types, made)

    def _take_single(self) -> None:
        if self._single:
            self._chunks.append(columns_of(self._single, self.types))
            self._single = []


def columns_of(rows: list[Mapping[str, Any]], types: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """Single rows as columns."""
    made: dict[str, NDArray[Any]] = {}
    for column, kind in types.items():
        made[column] = np.empty(len(rows), ARRAY_TYPES[kind])
        # Assigned, because numpy would make texts an array of fixed width.
        made[column][:] = [row[column] for row in rows]
    return made


def needed(library: str, extra: str) -> Any:
    """A library of an extra. Raises MisuseError with the command that installs it."""
    try:
        return import_module(library)
    except ImportError:
        raise MisuseError(f"this needs {library}: {install(extra)}") from None


def _arrow_schema(types: Mapping[str, str], text: str) -> Any:
    """The schema of a table in Arrow; `text` names the type of texts."""
    arrow = needed("pyarrow", "parquet")
    # A type has the name of numpy's, which is its alias in Arrow.
    names = {name: text if kind == "text" else kind for name, kind in types.items()}
    return arrow.schema([(name, arrow.type_for_alias(alias)) for name, alias in names.items()])


# --- files ---

BUFFERED_ROWS: Final = 1 << 16
"""Rows that are buffered before they are written, so that a Parquet file has large groups."""


class Writer(Protocol):
    """Receives the rows of one table."""

    def row(self, values: Mapping[str, Any]) -> None:
        """Add one row."""
        ...

    def rows(self, columns: Mapping[str, Data]) -> None:
        """Add rows as columns of equal length."""
        ...

    def close(self) -> None:
        """Write what is left, and finish the file."""
        ...


class FileWriter(Gathered):
    """Base of writers: gathers rows until there are BUFFERED_ROWS.

    `spelled` has the last ids by column, with their Arrow array: ids are often the same object in
    the next frame, and expensive to spell. Writers of one table may share it.
    """

    def __init__(self, types: Mapping[str, str]) -> None:
        super().__init__("", types)
        self._waiting = 0
        self.spelled: dict[str, tuple[Ids, Any]] = {}

    def row(self, values: Mapping[str, Any]) -> None:
        """Add one row."""
        super().row(values)
        self._add(1)

    def rows(self, columns: Mapping[str, Data]) -> None:
        """Add rows as columns of equal length."""
        super().rows(columns)
        self._add(len(next(iter(columns.values()))))

    def _add(self, rows: int) -> None:
        # Memory is bounded, however many frames a run has.
        self._waiting += rows
        if self._waiting >= BUFFERED_ROWS:
            self._flush()

    def close(self) -> None:
        """Write what is left, and finish the file."""
        self._flush()
        self.finish()

    def _flush(self) -> None:
        waiting = self.waiting()
        if waiting is not None:
            self.write(waiting)
        self._chunks, self._waiting = [], 0

    def waiting(self) -> Mapping[str, Data] | None:
        """The gathered rows; None if there are none."""
        self._take_single()
        if len(self._chunks) > 1:
            # One large chunk instead of many small ones, which would be as many row groups.
            self._chunks = [self.table.to_dict()]
        return self._chunks[0] if self._chunks else None

    def write(self, columns: Mapping[str, Data]) -> None:
        """Write these rows."""
        raise NotImplementedError

    def finish(self) -> None:
        """Finish the file."""
        raise NotImplementedError


class CsvWriter(FileWriter):
    """Writes a .csv file, or texts of this format to a stream, which it does not close."""

    def __init__(self, into: Path | TextIO, types: Mapping[str, str]) -> None:
        super().__init__(types)
        self._is_path = isinstance(into, Path)
        self._file = (
            into.open("w", encoding="utf-8", newline="") if isinstance(into, Path) else into
        )
        self._csv = csv.writer(self._file, lineterminator="\n")
        self._csv.writerow(types)

    def write(self, columns: Mapping[str, Data]) -> None:
        """Write these rows."""
        lists = [texts(columns[name]).tolist() for name in self.types]
        self._csv.writerows(zip(*lists, strict=True))

    def finish(self) -> None:
        """Finish the file."""
        if self._is_path:
            self._file.close()
        else:
            self._file.flush()


class ArrowWriter(FileWriter):
    """Writes an .arrow file, compressed by LZ4, which takes less time than a Parquet file."""

    def __init__(self, path: Path, types: Mapping[str, str]) -> None:
        super().__init__(types)
        self._pa = needed("pyarrow", "parquet")
        # The mark, so that a later run may replace the file.
        self._schema = _arrow_schema(types, "string").with_metadata({"software": MARK})
        self._writer = self._open(path)

    def _open(self, path: Path) -> Any:
        ipc = needed("pyarrow.ipc", "parquet")
        return ipc.new_file(path, self._schema, options=ipc.IpcWriteOptions(compression="lz4"))

    def write(self, columns: Mapping[str, Data]) -> None:
        """Write these rows."""
        arrays = [self._array(name, columns[name]) for name in self.types]
        self._writer.write_table(self._pa.table(arrays, schema=self._schema))

    def _array(self, name: str, data: Data) -> Any:
        known = self.spelled.get(name)
        if known is not None and known[0] is data:
            return known[1]
        if isinstance(data, Ids):
            # From bytes, without a Python text for each id.
            made = self._pa.array(data.spelled, self._pa.binary()).cast(self._pa.string())
            self.spelled[name] = data, made
            return made
        return self._pa.array(data, self._schema.field(name).type)

    def finish(self) -> None:
        """Finish the file."""
        self._writer.close()


class ParquetWriter(ArrowWriter):
    """Writes a .parquet file; texts are dictionaries, as they repeat in each frame."""

    def _open(self, path: Path) -> Any:
        return needed("pyarrow.parquet", "parquet").ParquetWriter(path, self._schema)


class ColumnsWriter(FileWriter):
    """Writes a .columns file: the arrays of each chunk, in the order of the columns."""

    def __init__(self, path: Path, types: Mapping[str, str]) -> None:
        super().__init__(types)
        # Into a file for writing only, numpy writes by itself, and loses the reason of a failure.
        self._file: IO[bytes] = path.open("w+b")

    def write(self, columns: Mapping[str, Data]) -> None:
        """Write these rows."""
        for name, kind in self.types.items():
            for array in _plain(columns[name]) if kind == "text" else [columns[name]]:
                np.save(self._file, cast("NDArray[Any]", array), allow_pickle=False)

    def finish(self) -> None:
        """Finish the file."""
        self._file.close()


def _plain(data: Data) -> list[NDArray[Any]]:
    """Texts as the numbers of their bytes, and all bytes: numpy stores no texts of any length."""
    if isinstance(data, Ids):
        encoded = data.spelled.tolist()
    else:
        encoded = [text.encode() for text in data.tolist()]
    lengths = np.fromiter(map(len, encoded), np.int64, len(encoded))
    return [lengths, np.frombuffer(b"".join(encoded), np.uint8)]


def read_columns(path: Path, name: str, types: Mapping[str, str]) -> DataTable:
    """The table in a .columns file."""
    gathered = Gathered(name, types)
    with path.open("rb") as file:
        for chunk in chunks_in(file, types):
            gathered.rows(chunk)
    return gathered.table


def chunks_in(file: IO[bytes], types: Mapping[str, str]) -> Iterator[dict[str, NDArray[Any]]]:
    """The rows of a .columns file, in chunks as they were written."""
    while file.peek(1):  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
        chunk: dict[str, NDArray[Any]] = {}
        for name, kind in types.items():
            try:
                array = np.load(file, allow_pickle=False)
                if kind == "text":
                    ends = array.cumsum().tolist()
                    data = np.load(file, allow_pickle=False).tobytes()
                    array = np.empty(len(ends), object)
                    array[:] = [data[a:b].decode() for a, b in pairwise([0, *ends])]
            except Exception as error:  # numpy raises various exceptions for damaged files
                raise MisuseError(f"{file.name}: it is damaged: {error!s:.100}") from None
            chunk[name] = array
        yield chunk


_WRITERS: Final[Mapping[str, Any]] = {
    ".csv": CsvWriter,
    ".parquet": ParquetWriter,
    ".arrow": ArrowWriter,
    ".columns": ColumnsWriter,
}


def check_table(path: Path, *endings: str) -> None:
    """Raise MisuseError if tables cannot be written to a file of this name."""
    check_ending(path, endings or ENDINGS, "table")
    if not path.parent.is_dir():
        raise MisuseError(f"{path}: there is no folder {path.parent}")


def create_writer(path: Path, types: Mapping[str, str], final: Path | None = None) -> FileWriter:
    """A writer of one table; the suffix selects the format.

    Raises MisuseError, which names the `final` file if `path` is a draft of it.
    """
    try:
        return _WRITERS[ending_of(path)](path, types)
    except OSError as error:
        raise MisuseError(f"{final or path}: cannot be written: {reason_of(error)}") from None


def table_path(path: Path, table: str, several: bool) -> Path:
    """The file of one table: `run.parquet`, or `run-APerson.parquet` if there are several."""
    return path.with_name(f"{path.stem}-{table}{path.suffix}") if several else path
