"""Frames of a record as text: strings in the world's own language, and events."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from minerva_bus.frame.inputs import RecordedFrame
from minerva_bus.grammar.batch import AnyEvent, single
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.cursor import Cursor
from minerva_bus.log.errors import RecordError
from minerva_bus.log.info import kinds_in
from minerva_bus.log.reader import Record
from minerva_bus.wording import frames_up_to


@dataclass(frozen=True, slots=True)
class FrameBegin:
    """The string before a frame and the events in it; `frame` is None at the end of a record.

    `seconds` is world time.
    """

    number: int
    seconds: float
    string: Scene
    frame: RecordedFrame | None

    def events(self) -> Iterator[str]:
        """The events of the frame in order, as text."""
        return _texts(self.frame.events if self.frame is not None else ())

    def plain(self) -> dict[str, Any]:
        """The frame as a JSON object."""
        return {
            "frame": self.number,
            "seconds": self.seconds,
            "digest": self.string.digest.hex(),
            "string": str(self.string),
            "events": list(self.events()),
        }

    def lines(self) -> list[str]:
        """The frame as lines of text."""
        title = f"frame {self.number}, {self.seconds:.2f} s of the world: {_counted(self.string)}"
        about = [title, f"  digest  {self.string.digest.hex()}"]
        if self.frame is None:
            return [*about, "  the record ends here"]
        return [*about, "  events", *(f"    {event}" for event in self.events())]


@dataclass(frozen=True, slots=True)
class FrameEnd:
    """A frame and the string after it; `seconds` is world time at its end."""

    frame: RecordedFrame
    seconds: float
    string: Scene

    def plain(self) -> dict[str, Any]:
        """The frame as a JSON object."""
        return {
            "frame": self.frame.number,
            "seconds": self.seconds,
            "digest": self.frame.digest.hex(),
            "events": list(_texts(self.frame.events)),
            "string": str(self.string),
        }

    def lines(self) -> list[str]:
        """The frame as lines of text."""
        about = f"frame {self.frame.number}, until {self.seconds:.2f} s: {_counted(self.string)}"
        events = [f"    {event}" for event in _texts(self.frame.events)]
        return [about, f"  digest  {self.frame.digest.hex()}", *events]


def frames_after(record: Record, begin: int) -> Iterator[FrameEnd]:
    """The frames of a record from number `begin` on."""
    dt = record.description.world.dt
    cursor = Cursor(record)
    cursor.skip_to(begin)
    while (frame := cursor.ahead) is not None:
        string = cursor.advance()
        if frame.number >= begin:
            yield FrameEnd(frame, (frame.number + 1) * dt, string)


def moment_of(record: Record, number: int | None) -> FrameBegin:
    """A frame of a record, or its end for None. Raises RecordError for a missing frame."""
    end, string = record.last()
    dt = record.description.world.dt
    if number is None or number == end:
        return FrameBegin(end, end * dt, string, None)
    if not 0 <= number < end:
        raise RecordError(f"{record.path}: it has {frames_up_to(end)}, not {number}")
    cursor = Cursor(record)
    string = cursor.seek(number)
    frame = cursor.ahead
    recorded = frame is not None and frame.number == number
    return FrameBegin(number, number * dt, string, frame if recorded else None)


def written(string: Scene) -> str:
    """A string in the world's language, one outermost node per line; it can be parsed again."""
    return "\n· ".join([str(Scene((node,))) for node in string.nodes])


def _counted(string: Scene) -> str:
    agents = [f"{count:,} {kind}" for kind, count in kinds_in(string).items()]
    return ", ".join(agents) or "no agents"


def _texts(events: Sequence[AnyEvent]) -> Iterator[str]:
    return (str(event) for event in single(events))
