"""Reads files of tables: .csv and .parquet, of a run, an export or a sweep."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from minerva_bus.collect.table import DataTable, needed, typed_column
from minerva_bus.errors import MisuseError
from minerva_bus.outputs import is_stream, note_read

_WORDS: Final = {"True": True, "False": False, "true": True, "false": False, "": None}


def read_table(path: Path) -> DataTable:
    """The table in a file. Raises MisuseError if it cannot be read."""
    try:
        if is_stream(path):
            raise ValueError("it is a pipe or device; expected a file")
        note_read(path)
        columns = _csv(path) if path.suffix == ".csv" else _parquet(path)
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
