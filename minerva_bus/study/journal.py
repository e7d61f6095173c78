"""A journal of finished runs: one JSON object a line, on the disk before the next run counts.

Its first line says of which study it is. A line that was cut off by a crash is taken away; a
journal that another process writes is refused.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

from minerva_bus.errors import MisuseError


class Journal:
    """Lines in a file; opened to go on with it. Raises MisuseError."""

    def __init__(self, path: Path, study: Mapping[str, Any]) -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise MisuseError(f"{path}: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise MisuseError(f"{path}: another process is at this study") from None
        try:
            self.lines = self._read(study)
        except MisuseError:
            os.close(self._file)
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        os.close(self._file)

    def add(self, line: Mapping[str, Any]) -> None:
        """Put a line on the disk."""
        data = json.dumps(line, ensure_ascii=False).encode() + b"\n"
        while data:
            data = data[os.write(self._file, data) :]
        os.fsync(self._file)
        self.lines.append(dict(line))

    def _read(self, study: Mapping[str, Any]) -> list[dict[str, Any]]:
        data = self.path.read_bytes()
        whole = data.rfind(b"\n") + 1
        os.ftruncate(self._file, whole)
        os.lseek(self._file, whole, os.SEEK_SET)
        lines = [self._parsed(n, one) for n, one in enumerate(data[:whole].splitlines(), 1)]
        if not lines:
            self.lines: list[dict[str, Any]] = []
            self.add(study)
            return []
        told = lines[0]
        for key, value in study.items():
            if told.get(key) != value:
                raise MisuseError(
                    f"{self.path}: it is of another study: {key} {told.get(key)} there, {value}"
                    " here; name another file with -o"
                )
        return lines[1:]

    def _parsed(self, number: int, line: bytes) -> dict[str, Any]:
        try:
            found = json.loads(line)
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise no_line(self.path, number)
        return cast("dict[str, Any]", found)


def no_line(path: Path, number: int) -> MisuseError:
    """What to say of a line that was not written here."""
    return MisuseError(
        f"{path}:{number}: this is no line of a journal: take it away, or name another file with -o"
    )
