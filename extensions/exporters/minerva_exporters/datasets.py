"""Records in the formats of other tools: `export_dataset`, which `minerva export` calls.

An exporter is a function with the signature `Exporter`. Installed ones are entry points of the
group `minerva.exporters`, by the name of their format.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

from minerva_bus.entry_points import entries
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.files import note_read
from minerva_bus.launch.specs import load
from minerva_bus.values import path_of, text

EXPORTERS: Final = "minerva.exporters"


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


@dataclass(frozen=True, slots=True)
class Dataset:
    """A data set that was exported.

    Attributes:
        form: the name of its format.
        path: the file or folder.
        records: the records in it.
        counts: numbers of what it contains, by name, such as `messages`.

    """

    form: str
    path: Path
    records: tuple[Path, ...]
    counts: Mapping[str, int]

    def plain(self) -> dict[str, Any]:
        """A summary as a JSON object."""
        records = [str(record) for record in self.records]
        return {"format": self.form, "output": str(self.path), "records": records, **self.counts}

    def lines(self) -> list[str]:
        """A summary as text."""
        counts = ", ".join(f"{count:,} {name}" for name, count in self.counts.items())
        return [f"{self.path}  {self.form}  {counts}"]


def export_dataset(
    record: str | Path | Sequence[str | Path],
    into: str | Path,
    form: str,
    *,
    begin: int = 0,
    end: int | None = None,
    every: int = 1,
    agents: Iterable[str] = (),
    act: Iterable[str] = (),
    progress: ExportProgress = lambda done, last: None,
) -> Dataset:
    """Write records in the format of another tool.

    It runs none of the world's code, and reads frame by frame.

    Args:
        record: the file, .mcap; several for a format that has many episodes.
        into: a new folder; for `rerun` a .rrd file.
        form: `rosbag`, `rerun`, `lerobot`, or the name of another installed format.
        begin: the first frame.
        end: the last frame; default: the end of the record.
        every: frames from one pose or row to the next.
        agents: for `lerobot`, the ids or kinds of the agents whose lives are episodes.
        act: for `lerobot`, what is their action: types of events that they receive, or attributes.
        progress: called with the number of frames done and the total.

    Raises:
        RecordError: a record cannot be read, or has no such frame.
        MisuseError: there is no such format, its library is missing, an argument is wrong, or the
            output cannot be written.

    Example:
        >>> export_dataset("run.mcap", "run_bag", "rosbag").counts

    """
    records = tuple(map(Path, [record] if isinstance(record, str | Path) else record))
    choice = ExportChoice(begin, end, every, tuple(agents), tuple(act))
    for path in records:
        note_read(path)
    target = path_of("into", into)
    counts = _exporter(form)(records, target, choice, progress)
    return Dataset(form, target, records, counts)


def _exporter(form: str) -> Exporter:
    known = entries(EXPORTERS)
    if text("form", form) not in known:
        there = ", ".join(sorted(known)) or "none"
        raise MisuseError(
            f"no export to {form!r} is installed{nearest(form, list(known), f'there are {there}')}"
        )
    return load(known[form].value)
