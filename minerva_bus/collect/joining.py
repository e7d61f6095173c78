"""Joins the parts of a table into one file, in bounded memory.

A process that was frozen and replaced may complete a part that its successor has written, too: then
parts have rows of the same frames. These rows are equal, and only those of one part count.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from minerva_bus.collect.table import needed
from minerva_bus.collect.writers import ParquetWriter, chunks_in, create_writer
from minerva_bus.errors import MisuseError

_PART_ENDINGS: Final = {".parquet": ".arrow"}


def part_ending(ending: str) -> str:
    """The ending of the parts of files with this ending."""
    return _PART_ENDINGS.get(ending, ending)


@dataclass(frozen=True, slots=True)
class JoinedPart:
    """A complete part; its rows of frames before `begin` are in an earlier part, too."""

    path: Path
    begin: int = 0


def join_parts(parts: Sequence[JoinedPart], into: Path, types: Mapping[str, str]) -> None:
    """Write the rows of all parts to a file. Raises MisuseError and OSError."""
    if not parts:
        create_writer(into, types).close()
    elif into.suffix == ".parquet":
        _join_arrow(parts, into, types)
    else:
        _join_bytes(parts, into, types)


def _join_bytes(parts: Sequence[JoinedPart], into: Path, types: Mapping[str, str]) -> None:
    """Copy the parts one after the other; those of .csv files begin with the column names."""
    with into.open("wb") as whole:
        for number, part in enumerate(parts):
            path, is_copy = part.path, False
            if _begins(part, types) < part.begin:
                path, is_copy = _shortened(part, into, types), True
            with path.open("rb") as file:
                # Names of columns are identifiers, so they have no line break.
                names = file.readline() if into.suffix == ".csv" else b""
                whole.write(b"" if number else names)
                shutil.copyfileobj(file, whole)
            if is_copy:
                path.unlink()


def _begins(part: JoinedPart, types: Mapping[str, str]) -> int:
    """The first frame of a part."""
    if part.path.suffix == ".csv":
        with part.path.open(encoding="utf-8", newline="") as lines:
            return next((int(row["frame"]) for row in csv.DictReader(lines)), part.begin)
    with part.path.open("rb") as file:
        return next((int(chunk["frame"][0]) for chunk in chunks_in(file, types)), part.begin)


def _shortened(part: JoinedPart, into: Path, types: Mapping[str, str]) -> Path:
    """A copy of a part beside a file, without the rows before its beginning."""
    path = into.with_name(f".short{into.suffix}")
    if into.suffix == ".csv":
        place = list(types).index("frame")
        with (
            part.path.open(encoding="utf-8", newline="") as lines,
            path.open("w", encoding="utf-8", newline="") as copy,
        ):
            rows, writer = csv.reader(lines), csv.writer(copy, lineterminator="\n")
            writer.writerow(next(rows))
            writer.writerows(row for row in rows if int(row[place]) >= part.begin)
        return path
    writer = create_writer(path, types)
    with part.path.open("rb") as file:
        for chunk in chunks_in(file, types):
            counts = chunk["frame"] >= part.begin
            if counts.any():
                writer.write({name: column[counts] for name, column in chunk.items()})
    writer.finish()
    return path


def _join_arrow(parts: Sequence[JoinedPart], into: Path, types: Mapping[str, str]) -> None:
    writer = ParquetWriter(into, types)
    try:
        for part in parts:
            for rows in _batches(part.path):
                # The rows are in the order of frames.
                first = int(rows["frame"].to_numpy().searchsorted(part.begin))
                if first < len(rows):
                    writer.write_table(rows.slice(first) if first else rows)
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
