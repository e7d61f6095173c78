"""Joins the parts of a table into one file, in bounded memory.

A process that was frozen and replaced may complete a part that its successor has written, too: then
parts have rows of the same frames. These rows are equal, and only those of one part count.
"""

from __future__ import annotations

import csv
import io
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
    header = _csv_header(types) if into.suffix == ".csv" else b""
    with into.open("wb") as whole:
        whole.write(header)
        for part in parts:
            path, is_copy = part.path, False
            if _begins(part, types) < part.begin:
                path, is_copy = _shortened(part, into, types), True
            with path.open("rb") as file:
                if file.read(len(header)) not in (header, b""):
                    raise MisuseError(f"{path}: it is damaged: its first line names other columns")
                shutil.copyfileobj(file, whole)
            if is_copy:
                path.unlink()


def _begins(part: JoinedPart, types: Mapping[str, str]) -> int:
    """The first frame of a part. Raises MisuseError if it is damaged."""
    if part.path.suffix == ".csv":
        return next((frame for frame, _ in _csv_rows(part.path, types)), part.begin)
    with part.path.open("rb") as file:
        return next((int(chunk["frame"][0]) for chunk in chunks_in(file, types)), part.begin)


def _csv_header(types: Mapping[str, str]) -> bytes:
    """The first line of a .csv file."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(types)
    return line.getvalue().encode()


def _csv_rows(path: Path, types: Mapping[str, str]) -> Iterator[tuple[int, list[str]]]:
    """The rows of a .csv part with their frames. Raises MisuseError if it is damaged."""
    place = list(types).index("frame")
    with path.open(encoding="utf-8", newline="") as lines:
        rows = csv.reader(lines)
        try:
            next(rows, None)
            for row in rows:
                if len(row) != len(types):
                    raise ValueError(f"line {rows.line_num} has {len(row)} values")
                yield int(row[place]), row
        except (ValueError, csv.Error) as error:
            raise MisuseError(f"{path}: it is damaged: {error!s:.100}") from None


def _shortened(part: JoinedPart, into: Path, types: Mapping[str, str]) -> Path:
    """A copy of a part beside a file, without the rows before its beginning."""
    path = into.with_name(f".short{into.suffix}")
    if into.suffix == ".csv":
        with path.open("w", encoding="utf-8", newline="") as copy:
            writer, rows = csv.writer(copy, lineterminator="\n"), _csv_rows(part.path, types)
            writer.writerow(types)
            writer.writerows(row for frame, row in rows if frame >= part.begin)
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
