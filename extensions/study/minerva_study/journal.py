"""A journal of finished runs: a JSON object per line, flushed to disk every half second.

The first line describes the study. An incomplete last line, as after a crash, is removed; a journal
that another process writes is refused.
"""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, cast

from minerva_bus.errors import MisuseError
from minerva_bus.files import is_stream
from minerva_study.code_digests import differences

FLUSH_SECONDS: Final = 0.5


class StudyJournal:
    """The lines of a journal file, which is created or continued. Raises MisuseError."""

    def __init__(self, path: Path, study: Mapping[str, Any]) -> None:
        self.path = path
        self._flushed = 0.0
        # Neither a pipe nor a device keeps what was written.
        if is_stream(path):
            raise MisuseError(f"{path}: a pipe or device; expected a file")
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise MisuseError(f"{path}: {error.strerror}") from None
        try:
            # Before it is read: the last line may be incomplete only because another process writes
            # it.
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise MisuseError(f"{path}: another process is running this study") from None
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
        os.fsync(self._file)
        os.close(self._file)

    def add(self, line: Mapping[str, Any]) -> None:
        """Append a line; it survives this process at once, and a power cut soon.

        Raises MisuseError if it cannot be written; the lines so far remain.
        """
        try:
            self._append(line)
        except OSError as error:
            raise MisuseError(
                f"{self.path}: cannot be written: {error.strerror}; the same command continues with"
                " the runs that it has"
            ) from None
        self.lines.append(dict(line))

    def _append(self, line: Mapping[str, Any]) -> None:
        data = _encoded(line)
        while data:
            data = data[os.write(self._file, data) :]
        # Not for each line: a disk takes longer than a short run.
        if time.monotonic() - self._flushed >= FLUSH_SECONDS:
            os.fsync(self._file)
            self._flushed = time.monotonic()

    def _read(self, study: Mapping[str, Any]) -> list[dict[str, Any]]:
        data = self.path.read_bytes()
        whole = data.rfind(b"\n") + 1
        lines = [self._parsed(n, line) for n, line in enumerate(data[:whole].splitlines(), 1)]
        if not (lines or _encoded(study).startswith(data)):
            raise invalid_line(self.path, 1)
        differing = differences(lines[0], study) if lines else []
        if differing:
            raise MisuseError(
                f"{self.path}: its runs are of another study; different: {'; '.join(differing)};"
                " remove it to run all again, or choose another output"
            )
        # Not before: a file that is no journal of this study stays as it is.
        os.ftruncate(self._file, whole)
        os.lseek(self._file, whole, os.SEEK_SET)
        if not lines:
            # `add` appends to it; the description of the study is not a run and is not returned.
            self.lines: list[dict[str, Any]] = []
            self.add(study)
        return lines[1:]

    def _parsed(self, number: int, line: bytes) -> dict[str, Any]:
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            entry = None
        if not isinstance(entry, dict):
            raise invalid_line(self.path, number)
        return cast("dict[str, Any]", entry)


def _encoded(line: Mapping[str, Any]) -> bytes:
    return json.dumps(line, ensure_ascii=False).encode() + b"\n"


def invalid_line(path: Path, number: int) -> MisuseError:
    """An error about a line that no study has written."""
    return MisuseError(
        f"{path}:{number}: not a line of a journal; remove it, or choose another output"
    )
