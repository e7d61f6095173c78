"""What exports read and write: the frames of a record, and a new folder."""

from __future__ import annotations

import shutil
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from minerva_analysis.frame_texts import missing_frame
from minerva_bus.errors import MisuseError, RecordError
from minerva_bus.files import name_file
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.record import Cursor, Record


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


@dataclass(frozen=True, slots=True)
class FrameContents:
    """A frame of a record.

    `scene` is the string with which it begins, `after` that with which it ends. `readings` are
    sorted by topic and publisher. The string after the last frame is a `FrameContents` with what
    agents and norms sent in that frame; its `after` is `scene`.
    """

    number: int
    scene: Scene
    after: Scene
    events: tuple[AnyEvent, ...]
    readings: tuple[Readings, ...]


class RecordFrames:
    """The frames of a record from `begin` to `end` (default: all), read one by one.

    `last` is the number of the last one, and `length` that of the string after all frames of the
    record. Lost frames are missing. Raises RecordError, also if there is no frame `begin`.
    """

    def __init__(self, record: Record, begin: int = 0, end: int | None = None) -> None:
        self.length = length = record.last()[0]
        self.begin, self.last = begin, length if end is None else min(end, length)
        if not 0 <= begin <= self.last:
            raise RecordError(missing_frame(record.path, length, begin))
        self._record = record

    def __iter__(self) -> Iterator[FrameContents]:
        cursor, sensed = Cursor(self._record), _Sensed(self._record)
        cursor.skip_to(self.begin)
        sensed.take(self.begin - 1)
        while (frame := cursor.ahead) is not None and frame.number <= self.last:
            cursor.settle()
            before, number = cursor.scene, frame.number
            yield FrameContents(number, before, cursor.advance(), frame.events, sensed.take(number))
        if frame is None:
            number = cursor.number
            events = cursor.closing_events() if number == self.length else ()
            yield FrameContents(number, cursor.scene, cursor.scene, events, sensed.take(number))


class _Sensed:
    """The readings of a record, frame by frame."""

    def __init__(self, record: Record) -> None:
        self._dt = record.description.world.dt
        self._left = record.sensed()
        self._ahead = next(self._left, None)

    def take(self, number: int) -> tuple[Readings, ...]:
        """The readings up to this frame that were not taken before."""
        taken: list[Readings] = []
        while self._ahead is not None and round(self._ahead[0] / self._dt) <= number:
            if isinstance(self._ahead[1], Readings):
                taken.append(self._ahead[1])
            self._ahead = next(self._left, None)
        # Members publish in any order.
        return tuple(sorted(taken, key=lambda message: (message.topic, message.member)))
