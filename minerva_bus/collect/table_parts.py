"""Tables that survive a killed process: their rows are written as parts, joined at the end.

    sir.parquet.parts/                     while the run lasts
        tables.json                        the tables, with the types of their columns
        APerson-000000-119.arrow           rows of frames up to 119, a complete file of its own
        APerson-000001-131.arrow
        .APerson.parquet                   the table of an undisturbed run, not yet complete

A part gets its name when it is complete. So a killed process leaves complete parts, with all rows
up to the last `save`, and a process that repeats the frames since then continues the same tables.

Joining parts would encode all rows again, and a Parquet file cannot be read before its end is
written. So a table is written beside its parts, which are used only after a process was killed.
Parts take less time to write: those of a Parquet table are in the format Arrow IPC, all others are
arrays of numpy.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from itertools import accumulate
from pathlib import Path
from typing import Any, Final, cast

from numpy.typing import NDArray

from minerva_bus.collect.data_tables import (
    ARRAY_TYPES,
    Data,
    FileWriter,
    chunks_in,
    create_writer,
    needed,
    table_path,
)
from minerva_bus.collect.plans import TablePlan
from minerva_bus.errors import MisuseError
from minerva_bus.files import check_file, is_forced, reason_of, replacing, target_of
from minerva_bus.values import fast_dataclass

_ABOUT: Final = "tables.json"
_DRAFT: Final = ".draft"


def parts_of(path: Path) -> Path:
    """The folder of the parts of a table file."""
    target = target_of(path)
    return target.with_name(f"{target.name}.parts")


class TableParts:
    """The parts of the tables of one run, for a file `path`; see `table_path`.

    Args:
        path: of the joined file.
        tables: the types of columns, by table.
        again: continue the tables of a killed process.

    Raises MisuseError if there are parts of another run, or if a file cannot be written.

    """

    def __init__(
        self, path: Path, tables: Mapping[str, Mapping[str, str]], *, again: bool = False
    ) -> None:
        self.path = path
        self.folder = parts_of(path)
        self._tables = tables
        self._again = again
        self._writers: dict[str, _PartWriter] = {}
        for name in tables:
            check_file(self._final(name), f"the table {name}")
        if not again:
            self._begin()
        if part := min(self.folder.glob("*-*-*.csv"), default=None):
            raise MisuseError(
                f"{part}: an earlier version of Minerva Bus wrote this part; make the tables with"
                " that version"
            )

    def _begin(self) -> None:
        # The parts of an internal file belong to a run without a user, such as one of a sweep.
        if self.path.suffix != ".columns":
            check_no_parts(self.path)
        shutil.rmtree(self.folder, ignore_errors=True)
        try:
            self.folder.mkdir()
            # It marks a table that has begun, also if there is no part yet.
            with replacing(self.folder / _ABOUT) as file:
                file.write(json.dumps(self._tables).encode())
        except OSError as error:
            raise MisuseError(f"{self.folder}: cannot be written: {error.strerror}") from None

    def open(self, plan: TablePlan) -> _PartWriter:
        """The writer of a table; rows of frames that its parts have are ignored."""
        writer = _PartWriter(self.folder, plan.name, plan.columns, part_ending(self.path.suffix))
        # Parts of a killed process have rows that a new file would lack.
        if self.path.suffix != ".columns" and not self._again:
            writer.write_whole(self._draft(plan.name))
        self._writers[plan.name] = writer
        return writer

    def save(self) -> None:
        """Write all rows so far, so that they survive the process."""
        for writer in self._writers.values():
            writer.save()

    def join(self) -> dict[str, Path]:
        """Join the parts of all tables, and remove them; returns the files. Raises MisuseError."""
        files = {name: self._final(name) for name in self._tables}
        try:
            for name, final in files.items():
                # A file may have appeared there during the run.
                check_file(final, f"the table {name}")
                self._join(name, target_of(final))
        except (OSError, MisuseError) as error:
            named = isinstance(error, OSError)
            why = f"{error.filename or self.path}: {reason_of(error)}" if named else error
            raise MisuseError(
                f"{why}; the rows are in {self.folder}: `minerva recover {self.folder}` continues"
            ) from None
        shutil.rmtree(self.folder, ignore_errors=True)
        return files

    def _final(self, name: str) -> Path:
        return table_path(self.path, name, len(self._tables) > 1)

    def _draft(self, name: str) -> Path:
        return self.folder / f".{name}{self.path.suffix}"

    def _join(self, name: str, final: Path) -> None:
        writer = self._writers.get(name)
        if writer is not None and writer.whole is not None:
            self._draft(name).replace(final)
            return
        parts = _parts(self.folder, name, part_ending(self.path.suffix))
        # Renamed, not copied: no copy is faster, and a kill leaves either the part or the file.
        if len(parts) == 1 and parts[0].path.suffix == final.suffix:
            parts[0].path.replace(final)
            return
        # A frozen process may still have this file open, and must not write into the new one.
        self._draft(name).unlink(missing_ok=True)
        ends = accumulate((part.last for part in parts), max, initial=-1)
        begun = ((part.path, end + 1) for part, end in zip(parts, ends, strict=False))
        join_parts(begun, self._draft(name), self._tables[name])
        self._draft(name).replace(final)


@fast_dataclass
class _TablePart:
    """A part of a table, with the last frame of which it has rows."""

    number: int
    last: int
    path: Path


def _parts(folder: Path, table: str, suffix: str) -> list[_TablePart]:
    """The parts of a table, in order."""
    latest: dict[int, _TablePart] = {}
    for path in folder.glob(f"{table}-*{suffix}"):
        words = path.stem.removeprefix(f"{table}-").split("-")
        if len(words) == 2 and words[0].isdecimal() and words[1].isdecimal():
            part = _TablePart(int(words[0]), int(words[1]), path)
            # A process killed between writing a part again and removing the old one leaves both.
            if part.number not in latest or part.last > latest[part.number].last:
                latest[part.number] = part
    return [latest[number] for number in sorted(latest)]


class _PartWriter(FileWriter):
    """Writes the parts of one table."""

    def __init__(self, folder: Path, name: str, types: Mapping[str, str], suffix: str) -> None:
        super().__init__(types)
        self._folder = folder
        self._name = name
        self._suffix = suffix
        parts = _parts(folder, name, suffix)
        self._number = parts[-1].number + 1 if parts else 0
        self._last = parts[-1].last if parts else -1
        self._saved: Path | None = None
        self.whole: FileWriter | None = None

    def write_whole(self, path: Path) -> None:
        """Also write all rows to a file, which is complete after `close`."""
        self.whole = create_writer(path, self.types)
        # Each id is spelled once.
        self.whole.spelled = self.spelled

    def row(self, values: Mapping[str, Any]) -> None:
        """Add one row, unless a part has it."""
        if values["frame"] > self._last:
            super().row(values)

    def rows(self, columns: Mapping[str, Data]) -> None:
        """Add rows of one frame, unless a part has them."""
        frames = columns["frame"]
        if len(frames) and cast("Any", frames)[0] > self._last:
            super().rows(columns)

    def save(self) -> None:
        """Write the rows that wait; a later part with the same rows and more replaces it."""
        waiting = self.waiting()
        if waiting is not None:
            self._put(waiting)

    def write(self, columns: Mapping[str, Data]) -> None:
        """Write a part that stays."""
        self._put(columns)
        self._number, self._saved = self._number + 1, None
        if self.whole is not None:
            self.whole.write(columns)

    def finish(self) -> None:
        """Finish the file of all rows; without it, `join` makes the file of the parts."""
        if self.whole is not None:
            self.whole.finish()

    def _put(self, columns: Mapping[str, Data]) -> None:
        last = int(cast("Any", columns["frame"])[-1])
        path = self._folder / f"{self._name}-{self._number:06}-{last}{self._suffix}"
        if path == self._saved:
            return  # It has these rows.
        # Random, because a process that was frozen and replaced may have one of its own.
        draft = self._folder / f"{_DRAFT}.{secrets.token_hex(4)}{self._suffix}"
        writer = create_writer(draft, self.types)
        writer.spelled = self.spelled
        writer.write(columns)
        writer.finish()
        draft.replace(path)
        if self._saved is not None:
            self._saved.unlink()
        self._saved = path


def check_no_parts(path: Path) -> None:
    """Raise MisuseError if there are parts of another run for this file, or a user's folder."""
    folder = parts_of(path)
    if not os.path.lexists(folder):
        return
    if _about(folder) is None:
        raise MisuseError(
            f"{folder} exists and is no folder of tables; choose another path, or move it"
        )
    if not is_forced():
        raise MisuseError(
            f"{folder} has the tables of a run that was killed, or still runs; make files of them"
            f" with `minerva recover {folder}`, or remove the folder"
        )


def read_parts(folder: Path) -> TableParts:
    """The parts in a folder, to join them. Raises MisuseError for another folder."""
    path = folder.with_name(folder.name.removesuffix(".parts"))
    tables = _about(folder)
    if tables is None or path == folder:
        raise MisuseError(
            f"{folder} is not a folder with the parts of tables, such as sir.parquet.parts"
        )
    return TableParts(path, tables, again=True)


def _about(folder: Path) -> dict[str, dict[str, str]] | None:
    """The tables in a folder of parts; None if it is none."""
    try:
        tables = json.loads((folder / _ABOUT).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return cast("dict[str, dict[str, str]]", tables) if _are_tables(tables) else None


def _are_tables(tables: Any) -> bool:
    """Whether these are tables with names that are safe in paths, and columns of known types."""
    if not isinstance(tables, dict) or not tables:
        return False
    known = cast("dict[str, Any]", tables)
    if not all(name.isidentifier() and isinstance(known[name], dict) for name in known):
        return False
    types = [cast("dict[str, Any]", known[name]) for name in known]
    return all(
        "frame" in kinds and set(map(str, kinds.values())) <= {*ARRAY_TYPES} for kinds in types
    )


def has_parts(path: Path, tables: Mapping[str, Mapping[str, str]] | None = None) -> bool:
    """Whether there are parts of a run for this file, and of these tables if they are given."""
    known = _about(parts_of(path))
    return known is not None and (tables is None or known == tables)


def part_ending(ending: str) -> str:
    """The ending of the parts of files with this ending."""
    return ".arrow" if ending.lower() == ".parquet" else ".columns"


def join_parts(parts: Iterable[tuple[Path, int]], into: Path, types: Mapping[str, str]) -> None:
    """Write the rows of all parts to a file, those of each part from a frame on.

    An earlier part has the rows of frames before it, too. Raises MisuseError and OSError.
    """
    writer = create_writer(into, types)
    try:
        for path, begin in parts:
            for rows in _rows(path, types):
                # The rows are in the order of frames.
                first = int(rows["frame"].searchsorted(begin))
                if first < len(rows["frame"]):
                    writer.write({name: column[first:] for name, column in rows.items()})
    finally:
        writer.finish()


def _rows(part: Path, types: Mapping[str, str]) -> Iterator[dict[str, NDArray[Any]]]:
    """The rows of a part, in tables as large as they were written. Raises MisuseError."""
    if part.suffix != ".arrow":
        with part.open("rb") as file:
            yield from chunks_in(file, types)
        return
    arrow, ipc = needed("pyarrow", "parquet"), needed("pyarrow.ipc", "parquet")
    try:
        with arrow.memory_map(str(part)) as source:
            file = ipc.open_file(source)
            for number in range(file.num_record_batches):
                rows = file.get_batch(number)
                yield {name: rows[name].to_numpy(zero_copy_only=False) for name in types}
    except (arrow.ArrowInvalid, arrow.ArrowIOError) as error:
        what = str(error).partition("\n")[0]
        raise MisuseError(f"{part} is not a complete Arrow file: {what}") from None
