"""Reads files of tables: .csv and .parquet, of a run, an export or a sweep."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from minerva_bus.collect.table import ARRAY_TYPES, DataTable, needed
from minerva_bus.errors import MisuseError
from minerva_bus.outputs import note_read

_WORDS: Final = {"True": True, "False": False, "true": True, "false": False, "": None}


def read_table(path: Path) -> DataTable:
    """The table in a file. Raises MisuseError if it cannot be read."""
    try:
        note_read(path)
        columns = _csv(path) if path.suffix == ".csv" else _parquet(path)
    except (OSError, ValueError, csv.Error) as error:
        why = getattr(error, "strerror", None) or str(error).split("\n", 1)[0]
        raise MisuseError(f"{path}: no table can be read: {why}") from None
    types = {name: _type_of(values) for name, values in columns.items()}
    arrays = {name: _array(values, types[name]) for name, values in columns.items()}
    return DataTable(path.stem, types, arrays)


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


def _type_of(values: list[Any]) -> str:
    kinds: set[type[Any]] = {type(value) for value in values}
    if kinds == {bool}:
        return "bool"
    if kinds == {int} and all(abs(value) < 1 << 63 for value in values):
        return "int64"
    return "float64" if kinds and kinds <= {int, float, type(None)} else "text"


def _array(values: list[Any], kind: str) -> Any:
    made = np.empty(len(values), ARRAY_TYPES[kind])
    if kind == "float64":
        values = [np.nan if value is None else value for value in values]
    elif kind == "text":
        values = ["" if value is None else str(value) for value in values]
    made[:] = values
    return made
