"""Interface of exports of whole records to the formats of other tools.

An exporter is a function with the signature `Exporter`. Installed ones are entry points of the
group `minerva.exporters`, by the name of their format.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from minerva_bus.errors import MisuseError
from minerva_bus.files import name_file


@dataclass(frozen=True, slots=True)
class ExportChoice:
    """What to export of records. Raises MisuseError.

    Attributes:
        begin, end: the first and last frame; None: the end of the record.
        every: frames from one pose or row to the next.
        agents: ids or kinds of the agents whose lives are episodes; empty: those of the only kind.
        act: what is an action: types of events that the agents receive, or their attributes.

    """

    begin: int = 0
    end: int | None = None
    every: int = 1
    agents: tuple[str, ...] = ()
    act: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.every < 1:
            raise MisuseError(f"every {self.every} frames; expected at least 1")


ExportProgress: TypeAlias = Callable[[int, int], None]
"""Called with the number of frames done and the total."""

Exporter: TypeAlias = Callable[
    [Sequence[Path], Path, ExportChoice, ExportProgress], Mapping[str, int]
]
"""Writes records into a file or a folder; returns numbers of what it wrote, by name.

Raises RecordError, and MisuseError if the output cannot be written or a library is missing.
"""


def only_record(paths: Sequence[Path], form: str) -> Path:
    """The path, if there is one only. Raises MisuseError."""
    if len(paths) != 1:
        raise MisuseError(f"{form}: {len(paths)} records; one file has one run: export each record")
    return paths[0]


@contextmanager
def new_folder(path: Path, form: str) -> Generator[None]:
    """A new folder for an export, which is removed if the export fails.

    Raises MisuseError if there is something at `path` that it would replace.
    """
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise MisuseError(f"{form}: {path} exists already; remove it, or name a new folder")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MisuseError(f"{form}: cannot write {path}: {error.strerror}") from None
    try:
        yield
    except BaseException as error:
        shutil.rmtree(path, ignore_errors=True)
        name_file(error, path)
        raise
