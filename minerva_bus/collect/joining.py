"""Joins the parts of a table into one file without decoding their rows.

A Parquet file ends with a footer that has the places of its row groups. Joined, the groups of all
parts follow each other, and a new footer has their new places. So a table of any size is joined as
fast as it is copied.

Source: https://github.com/apache/parquet-format (parquet.thrift: FileMetaData, RowGroup,
ColumnChunk, ColumnMetaData).
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Final

from minerva_bus.collect.thrift import Item, decode, encode
from minerva_bus.errors import MisuseError

_MAGIC: Final = b"PAR1"
_TAIL: Final = 8
"""Bytes after the footer: its length (4 bytes, little endian) and the magic number."""

# Numbers of fields.
_ROWS, _GROUPS = 3, 4  # of FileMetaData
_COLUMNS, _GROUP_OFFSET, _ORDINAL = 1, 5, 7  # of RowGroup
_META: Final = 3  # of ColumnChunk
_CHUNK_OFFSETS: Final = (2, 4, 6)
_PAGE_OFFSETS: Final = (9, 10, 11, 14)  # of ColumnMetaData


def join_parts(parts: Sequence[Path], into: IO[bytes], suffix: str) -> None:
    """Write the rows of all parts, at least one, to a file. Raises MisuseError and OSError."""
    _JOINERS[suffix](parts, into)


def _join_bytes(parts: Sequence[Path], into: IO[bytes]) -> None:
    for part in parts:
        with part.open("rb") as file:
            shutil.copyfileobj(file, into)


def _join_csv(parts: Sequence[Path], into: IO[bytes]) -> None:
    for number, part in enumerate(parts):
        with part.open("rb") as file:
            # Each part begins with the names of columns, which are identifiers.
            head = file.readline()
            if not number:
                into.write(head)
            shutil.copyfileobj(file, into)


def _join_parquet(parts: Sequence[Path], into: IO[bytes]) -> None:
    into.write(_MAGIC)
    whole: list[Item] = []
    for part in parts:
        with part.open("rb") as file:
            footer, end = _footer(file, part)
            _shift_groups(footer, into.tell() - len(_MAGIC))
            file.seek(len(_MAGIC))
            _copy(file, into, end - len(_MAGIC))
        if not whole:
            whole = footer
        else:
            _field(whole, _ROWS).value += _field(footer, _ROWS).value
            _field(whole, _GROUPS).value.values += _field(footer, _GROUPS).value.values
    data = encode(whole)
    into.write(data + len(data).to_bytes(4, "little") + _MAGIC)


def _copy(file: IO[bytes], into: IO[bytes], length: int) -> None:
    while length > 0:
        block = file.read(min(length, 1 << 20))
        if not block:
            raise MisuseError("a part became shorter while it was read")
        into.write(block)
        length -= len(block)


def _footer(file: IO[bytes], path: Path) -> tuple[list[Item], int]:
    """The footer of a Parquet file, and where it begins. Raises MisuseError."""
    size = file.seek(0, os.SEEK_END)
    if size > len(_MAGIC) + _TAIL:
        file.seek(size - _TAIL)
        tail = file.read(_TAIL)
        begin = size - _TAIL - int.from_bytes(tail[:4], "little")
        if tail[4:] == _MAGIC and begin >= len(_MAGIC):
            file.seek(begin)
            try:
                return decode(file.read(size - _TAIL - begin)), begin
            except ValueError:
                pass
    raise MisuseError(f"{path} is not a complete Parquet file")


def _field(fields: list[Item], number: int) -> Item:
    return next(field for field in fields if field.number == number)


def _shift_groups(footer: list[Item], by: int) -> None:
    for group in _field(footer, _GROUPS).value.values:
        # The number of a group within its file has two bytes, and readers do not need it.
        group[:] = [field for field in group if field.number != _ORDINAL]
        _shift(group, (_GROUP_OFFSET,), by)
        for chunk in _field(group, _COLUMNS).value.values:
            _shift(chunk, _CHUNK_OFFSETS, by)
            for meta in [field for field in chunk if field.number == _META]:
                _shift(meta.value, _PAGE_OFFSETS, by)


def _shift(fields: list[Item], numbers: tuple[int, ...], by: int) -> None:
    for field in fields:
        # Zero means that there is no such place.
        if field.number in numbers and field.value:
            field.value += by


_JOINERS: Final[Mapping[str, Callable[[Sequence[Path], IO[bytes]], None]]] = {
    ".csv": _join_csv,
    ".parquet": _join_parquet,
    ".columns": _join_bytes,
}
