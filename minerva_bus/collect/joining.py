"""Joins the parts of a table into one file, in bounded memory."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from minerva_bus.collect.table import needed
from minerva_bus.collect.writers import ParquetWriter, create_writer
from minerva_bus.errors import MisuseError

_PART_ENDINGS: Final = {".parquet": ".arrow"}


def part_ending(ending: str) -> str:
    """The ending of the parts of files with this ending."""
    return _PART_ENDINGS.get(ending, ending)


def join_parts(parts: Sequence[Path], into: Path, types: Mapping[str, str]) -> None:
    """Write the rows of all parts to a file. Raises MisuseError and OSError."""
    if not parts:
        create_writer(into, types).close()
    elif into.suffix == ".parquet":
        _join_arrow(parts, into, types)
    else:
        _join_bytes(parts, into, head=into.suffix == ".csv")


def _join_bytes(parts: Sequence[Path], into: Path, *, head: bool) -> None:
    """Copy the parts one after the other; `head`: each begins with a line of column names."""
    with into.open("wb") as whole:
        for number, part in enumerate(parts):
            with part.open("rb") as file:
                # Names of columns are identifiers, so they have no line break.
                names = file.readline() if head else b""
                whole.write(b"" if number else names)
                shutil.copyfileobj(file, whole)


def _join_arrow(parts: Sequence[Path], into: Path, types: Mapping[str, str]) -> None:
    writer = ParquetWriter(into, types)
    try:
        for part in parts:
            for rows in _batches(part):
                writer.write_table(rows)
    finally:
        writer.finish()


def _batches(part: Path) -> Iterator[Any]:
    """The rows of an .arrow file, in tables as large as they were written."""
    arrow, ipc = needed("pyarrow", "parquet"), needed("pyarrow.ipc", "parquet")
    try:
        with arrow.memory_map(str(part)) as source:
            file = ipc.open_file(source)
            for number in range(file.num_record_batches):
                yield arrow.Table.from_batches([file.get_batch(number)])
    except (arrow.ArrowInvalid, arrow.ArrowIOError) as error:
        what = str(error).partition("\n")[0]
        raise MisuseError(f"{part} is not a complete Arrow file: {what}") from None
