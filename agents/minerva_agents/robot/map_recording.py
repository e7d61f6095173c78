"""`minerva map`: the occupancy map of a recording."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from itertools import chain, repeat
from pathlib import Path
from typing import Final

from minerva_agents.robot.mapping import MapChoice, draw
from minerva_bus.cli.output import Done, print_report
from minerva_bus.entry_points import entries
from minerva_bus.errors import WorldFileError, nearest
from minerva_bus.files import forget_inputs
from minerva_bus.launch.console import progress_bar
from minerva_bus.launch.specs import load
from minerva_bus.log.recordings import PassOver, Progress, Recording, RecordingError

RECORDINGS: Final = "minerva.recordings"

_STEPS: Final = 100


def map_recording(
    file: Path,
    output: Path | None,
    cell: float,
    farthest: float,
    begin: float,
    end: float | None,
    poses: str = "published",
    time_offset: float = 0.0,
    *,
    as_json: bool = False,
) -> None:
    """Draw the map of a recording into OUTPUT.pgm, .yaml and .png. Raises MinervaError.

    `cell` and `farthest` are metres (0: as recorded), `begin` and `end` seconds; for
    `poses` and `time_offset` see `MapChoice`.
    """
    last = math.inf if end is None else end
    forget_inputs()
    choice = MapChoice(cell, farthest, begin, last, poses, time_offset)
    into = output or Path(f"{file.name.partition('.')[0]}.pgm")
    passed = _Passed()
    with _progress(file.name) as progress:
        try:
            made = draw(_opener(file, passed), into, choice, progress)
        except RecordingError as error:
            raise RecordingError(f"{error}{passed.unsaid(str(error))}") from None
    notes = [*passed.lines(), *made]
    print_report(Done("\n".join(notes), {"map": str(into), "notes": notes}), as_json)


def _opener(file: Path, passed: PassOver) -> Callable[[], Recording]:
    """Open the recording by its suffix; report skipped data only the first time."""
    if not file.exists():
        raise WorldFileError(f"there is no file {file}; expected a recording: check its name")
    # A bag of ROS 2 is a folder.
    suffix = "db3" if file.is_dir() else file.name.removesuffix(".gz").rpartition(".")[2].lower()
    known = entries(RECORDINGS)
    if suffix not in known:
        hint = nearest(suffix, list(known), f"there are {', '.join(sorted(known)) or 'none'}")
        raise WorldFileError(
            f"{file}: reader of recordings: none for {suffix!r} is installed{hint}"
        )
    read = load(known[suffix].value)
    # The mapper reads the recording several times.
    reporters = chain([passed], repeat(_silently))
    return lambda: read(file, next(reporters))


def _silently(what: str, line: str) -> None:
    """Report nothing again."""


class _Passed:
    """Skipped data: the first of each kind, and their number."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}
        self._counts: Counter[str] = Counter()

    def __call__(self, what: str, line: str) -> None:
        self._first.setdefault(what, line)
        self._counts[what] += 1

    def unsaid(self, error: str) -> str:
        """The end of an error: what was skipped, as far as the error does not say it."""
        # An error about a file begins with its path, as a line does, and says it once.
        said = {line for line in self._first.values() if line.partition(": ")[2] in error}
        return "".join(f"; {line}" for line in self._first.values() if line not in said)

    def lines(self) -> list[str]:
        return [f"{line} ({what}: {self._counts[what]})" for what, line in self._first.items()]


@contextmanager
def _progress(label: str) -> Generator[Progress]:
    """A progress bar on standard error, if it is a terminal."""
    with progress_bar(label) as show:
        yield lambda part: show(int(part * _STEPS), _STEPS)
