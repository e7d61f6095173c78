"""Files of tables, written in bounded memory while a world runs.

.csv        texts, for any program
.parquet    needs pyarrow
.arrow      needs pyarrow; the parts of a Parquet file, see parts.py
.columns    arrays of numpy in sequence, in which a coordinator passes tables to its caller
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Final, Protocol, TextIO

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.rows import Data
from minerva_bus.collect.table import DataTable, Gathered, columns_of, needed, texts
from minerva_bus.errors import MisuseError
from minerva_bus.file_marks import MARK
from minerva_bus.grammar.ids import Ids
from minerva_bus.outputs import check_output

ENDINGS: Final = (".csv", ".parquet", ".columns")
"""Endings of files that are not parts."""
BUFFERED_ROWS: Final = 1 << 16
"""Rows that are buffered before they are written, so that a Parquet file has large groups."""
_END: Final = b"$"


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


class FileWriter:
    """Base of writers: gathers rows until there are BUFFERED_ROWS.

    `spelled` has the last ids by column, with their Arrow array: ids are often the same object in
    the next frame, and expensive to spell. Writers of one table may share it.
    """

    def __init__(self, types: Mapping[str, str]) -> None:
        self.types = types
        self._single: list[Mapping[str, Any]] = []
        self._chunks: list[Mapping[str, Data]] = []
        self._waiting = 0
        self.spelled: dict[str, tuple[Ids, Any]] = {}

    def row(self, values: Mapping[str, Any]) -> None:
        """Add one row."""
        self._single.append(values)
        self._add(1)

    def rows(self, columns: Mapping[str, Data]) -> None:
        """Add rows as columns of equal length."""
        self._chunks.append(columns)
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
        if self._single:
            self._chunks.append(columns_of(self._single, self.types))
            self._single = []
        if len(self._chunks) > 1:
            # One large chunk instead of many small ones, which would be as many row groups.
            gathered = Gathered("", self.types)
            for chunk in self._chunks:
                gathered.rows(chunk)
            self._chunks = [gathered.table.to_dict()]
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
        kinds = {"float64": self._pa.float64(), "int64": self._pa.int64(), "bool": self._pa.bool_(),
                 "text": self._pa.string()}  # fmt: skip
        # The mark, so that a later run may replace the file.
        self._schema = self._pa.schema(
            [(name, kinds[kind]) for name, kind in types.items()], {"software": MARK}
        )
        self._writer = self._open(path)

    def _open(self, path: Path) -> Any:
        ipc = needed("pyarrow.ipc", "parquet")
        return ipc.new_file(path, self._schema, options=ipc.IpcWriteOptions(compression="lz4"))

    def write(self, columns: Mapping[str, Data]) -> None:
        """Write these rows."""
        arrays = [self._array(name, columns[name]) for name in self.types]
        self.write_table(self._pa.table(arrays, schema=self._schema))

    def write_table(self, table: Any) -> None:
        """Write a `pyarrow.Table` with the columns of this file."""
        self._writer.write_table(table)

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
        self._file: IO[bytes] = path.open("wb")

    def write(self, columns: Mapping[str, Data]) -> None:
        """Write these rows."""
        for name, kind in self.types.items():
            array = texts(columns[name])
            np.save(self._file, _plain(array) if kind == "text" else array, allow_pickle=False)

    def finish(self) -> None:
        """Finish the file."""
        self._file.close()


def _plain(array: NDArray[Any]) -> NDArray[Any]:
    """Texts as bytes of one width, which numpy stores without pickling."""
    # One more byte marks the end, because numpy drops NUL characters at the end of fixed widths.
    encoded = [text.encode() + _END for text in array.tolist()]
    return np.array(encoded, f"S{max(map(len, encoded), default=1)}")


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
                    decoded = [text.removesuffix(_END).decode() for text in array.tolist()]
                    # The None keeps numpy from making a fixed-width text array.
                    array = np.array([*decoded, None], object)[:-1]
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


def check_ending(path: Path) -> None:
    """Raise MisuseError if tables cannot be written to a file of this name."""
    if path.suffix not in ENDINGS:
        raise MisuseError(f"{path}: expected a file name that ends with .parquet or .csv")
    if not path.parent.is_dir():
        raise MisuseError(f"{path}: there is no folder {path.parent}")


def open_writer(path: Path, name: str, types: Mapping[str, str]) -> Writer:
    """A writer of one table; the suffix selects the format. Raises MisuseError."""
    check_ending(path)
    check_output(path, f"the table {name}")
    return create_writer(path, types)


def create_writer(path: Path, types: Mapping[str, str], final: Path | None = None) -> FileWriter:
    """As `open_writer`, without checks; errors name the `final` file of which `path` is a draft."""
    try:
        return _WRITERS[path.suffix](path, types)
    except OSError as error:
        # pyarrow's text contains the path.
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise MisuseError(f"{final or path}: cannot be written: {reason}") from None


def path_of(path: Path, table: str, several: bool) -> Path:
    """The file of one table: `run.parquet`, or `run-APerson.parquet` if there are several."""
    return path.with_name(f"{path.stem}-{table}{path.suffix}") if several else path
