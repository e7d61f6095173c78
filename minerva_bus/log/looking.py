"""One moment of a record, as text: the string of a frame in the world's own language."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from minerva_bus.grammar.batch import single
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.errors import RecordError
from minerva_bus.log.info import kinds_in
from minerva_bus.log.messages import Frame
from minerva_bus.log.reader import Record
from minerva_bus.wording import frames_up_to


@dataclass(frozen=True, slots=True)
class Moment:
    """What a frame begins with, its string, and what happens in it; `frame` is None at the end."""

    number: int
    seconds: float
    string: Scene
    frame: Frame | None

    def events(self) -> Iterator[str]:
        """The events of the frame in their order, as text."""
        return (str(one) for one in single(self.frame.events if self.frame is not None else ()))

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "frame": self.number,
            "seconds": self.seconds,
            "digest": self.string.digest.hex(),
            "string": str(self.string),
            "events": list(self.events()),
        }

    def lines(self) -> list[str]:
        """As a person reads it."""
        agents = ", ".join([f"{count:,} {kind}" for kind, count in kinds_in(self.string).items()])
        title = f"frame {self.number}, {self.seconds:.2f} s of the world: {agents or 'no agents'}"
        about = [title, f"  digest  {self.string.digest.hex()}"]
        if self.frame is None:
            return [*about, "  the record ends here"]
        return [*about, "  events", *(f"    {one}" for one in self.events())]


@dataclass(frozen=True, slots=True)
class Done:
    """A frame, and the string after it."""

    frame: Frame
    seconds: float
    string: Scene

    def plain(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "frame": self.frame.number,
            "seconds": self.seconds,
            "digest": self.frame.digest.hex(),
            "events": [str(one) for one in single(self.frame.events)],
            "string": str(self.string),
        }

    def lines(self) -> list[str]:
        """As a person reads it."""
        agents = ", ".join([f"{count:,} {kind}" for kind, count in kinds_in(self.string).items()])
        about = f"frame {self.frame.number}, until {self.seconds:.2f} s: {agents or 'no agents'}"
        events = [f"    {one}" for one in single(self.frame.events)]
        return [about, f"  digest  {self.frame.digest.hex()}", *events]


def frames_after(record: Record, begin: int) -> Iterator[Done]:
    """The frames of a record from number `begin` on, each with the string after it."""
    dt = record.description.world.dt
    for frame, string in record.play(begin):
        yield Done(frame, (frame.number + 1) * dt, string)


def moment_of(record: Record, number: int | None) -> Moment:
    """A frame of a record, None: its end. Raises RecordError where it is not in it."""
    end, string = record.last()
    dt = record.description.world.dt
    if number is None or number == end:
        return Moment(end, end * dt, string, None)
    if not 0 <= number < end:
        raise RecordError(f"{record.path}: it has {frames_up_to(end)}, not {number}")
    string = record.string(number)
    frame, _ = next(record.play(number))
    return Moment(number, number * dt, string, frame if frame.number == number else None)


def written(string: Scene) -> str:
    """A string in the world's own language, one outermost node a line; it can be read again."""
    return "\n· ".join([str(Scene((node,))) for node in string.nodes])
