"""Tables of plain values, and tables in files."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.collect.data_tables import ARRAY_TYPES, DataTable, needed
from minerva_bus.errors import MisuseError
from minerva_bus.files import ending_of, is_stream, note_read

_WORDS: Final = {"True": True, "False": False, "true": True, "false": False, "": None}


def read_table(path: Path) -> DataTable:
    """The table in a file. Raises MisuseError if it cannot be read."""
    try:
        if is_stream(path):
            raise ValueError("it is a pipe or device; expected a file")
        note_read(path)
        columns = _csv(path) if ending_of(path) == ".csv" else _parquet(path)
    except (OSError, ValueError, csv.Error) as error:
        why = getattr(error, "strerror", None) or str(error).split("\n", 1)[0]
        raise MisuseError(f"{path}: no table can be read: {why}") from None
    typed = {name: typed_column(values) for name, values in columns.items()}
    types = {name: kind for name, (kind, _) in typed.items()}
    return DataTable(path.stem, types, {name: array for name, (_, array) in typed.items()})


def _csv(path: Path) -> dict[str, list[Any]]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.reader(file)
        names: list[str] = next(rows, list[str]())
        if not names or len(set(names)) < len(names):
            raise ValueError("its first line must name the columns")
        columns: list[list[Any]] = [[] for _ in names]
        for row in rows:
            if len(row) != len(names):
                raise ValueError(f"line {rows.line_num} has {len(row)} values, not {len(names)}")
            for column, text in zip(columns, row, strict=True):
                column.append(plain_value(text, _WORDS))
    return dict(zip(names, columns, strict=True))


def plain_value(text: str, words: Mapping[str, Any]) -> Any:
    """A number if the text is one, otherwise what it means among the words, or the text itself."""
    for read in (int, float):
        try:
            return read(text)
        except ValueError:
            continue
    return words.get(text, text)


def _parquet(path: Path) -> dict[str, list[Any]]:
    table = needed("pyarrow.parquet", "parquet").read_table(path)
    return {name: table.column(name).to_pylist() for name in table.column_names}


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
