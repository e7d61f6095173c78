"""A record as a series of frames: strings, events and readings together, for exports."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.cursor import Cursor
from minerva_bus.log.errors import RecordError
from minerva_bus.log.reader import Record
from minerva_bus.wording import frames_up_to


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
            raise RecordError(f"{record.path}: it has {frames_up_to(length)}, not {begin}")
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
