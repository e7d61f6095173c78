"""Frames of a record as text, with strings in the language of the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from minerva_bus.errors import RecordError
from minerva_bus.grammar.events import AnyEvent, single
from minerva_bus.grammar.scene import Scene, kind_counts
from minerva_bus.log.record import Cursor, Record


def frames_up_to(end: int) -> str:
    """The frames before `end` in words: `no frames`, `frame 0 only`, `frames 0 to 12`."""
    if end <= 1:
        return "frame 0 only" if end == 1 else "no frames"
    return f"frames 0 to {end - 1}"


def missing_frame(path: Path, end: int, number: int) -> str:
    """What is wrong with the number of a frame that a record of the frames before `end` lacks."""
    return f"{path}: it has {frames_up_to(end)}, not {number}"


def kinds_in(scene: Scene) -> dict[str, int]:
    """Number of agents of each kind in a string."""
    return dict(sorted(kind_counts(*scene.pieces).items()))


@dataclass(frozen=True, slots=True)
class FrameText:
    """A frame of a record as text, with the string before or after it.

    `title` begins the text. `seconds` is the world time at the string, `digest` that of the string.
    `is_end`: the record ends here, and the `events` are what agents and norms sent in its last
    frame.
    """

    title: str
    number: int
    seconds: float
    string: Scene
    digest: bytes
    events: tuple[AnyEvent, ...]
    is_end: bool = False

    def plain(self) -> dict[str, Any]:
        """The frame as a JSON object."""
        return {
            "frame": self.number,
            "seconds": self.seconds,
            "digest": self.digest.hex(),
            "string": str(self.string),
            "events": list(map(str, single(self.events))),
        }

    def lines(self) -> list[str]:
        """The frame as lines of text."""
        agents = [f"{count:,} {kind}" for kind, count in kinds_in(self.string).items()]
        about = f"frame {self.number}, {self.title}: {', '.join(agents) or 'no agents'}"
        heading = "  the record ends here" if self.is_end else "  events"
        events = [f"    {event}" for event in single(self.events)]
        return [about, f"  digest  {self.digest.hex()}", heading, *events]


def frames_after(record: Record, begin: int) -> Iterator[FrameText]:
    """The frames of a record from number `begin` on. Raises RecordError if it has no such frame."""
    dt = record.description.world.dt
    cursor = Cursor(record)
    cursor.skip_to(begin)
    if begin < 0 or (begin and cursor.ahead is None):
        raise RecordError(missing_frame(record.path, record.last()[0], begin))
    while (frame := cursor.ahead) is not None:
        string = cursor.advance()
        if frame.number >= begin:
            seconds = (frame.number + 1) * dt
            title = f"until {seconds:.2f} s"
            yield FrameText(title, frame.number, seconds, string, frame.digest, frame.events)
