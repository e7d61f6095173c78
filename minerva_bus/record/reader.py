"""Reading a record: its frames, and the string of any of them."""

from __future__ import annotations

import json
from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from minerva_bus.errors import MinervaError
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.protocol.values import Reader
from minerva_bus.record import channels as c
from minerva_bus.record.checkpoints import Step, decode_checkpoint
from minerva_bus.record.chunks import Chunks
from minerva_bus.record.description import LIMITS, Description, decode_description
from minerva_bus.record.edits import edited
from minerva_bus.record.errors import RecordError
from minerva_bus.record.messages import Frame, decode_frame, decode_string, frame_number
from minerva_bus.record.sensing import Dropped, decode_sensed

if TYPE_CHECKING:
    from mcap.records import Message

_END: Final = 1 << 62


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of the log: when, in seconds of the world's time; about whom, and what."""

    time: float
    member: str
    text: str


class Record:
    """A record that is read; also the context in which its file is open.

        with Record(path) as record:
            for frame, string in record.strings():
                ...

    `description` says of which world it is. `complete`: it was closed as it should be; a record
    whose world has crashed has all but what came after the last flush. Raises RecordError, here
    and wherever it is read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._chunks = Chunks(path)
        self.complete = self._chunks.complete
        self.size = self._chunks.size
        try:
            self.description = self._description()
        except BaseException:
            self.close()
            raise
        self._reader = Reader(self.description.world.vocabulary, LIMITS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._chunks.close()

    def _description(self) -> Description:
        for _, message in self._chunks.messages((c.WORLD,)):
            try:
                return decode_description(message.data)
            except RecordError as error:
                raise RecordError(f"{self.path}: {error}") from None
        raise RecordError(f"{self.path}: it does not say of which world it is")

    def frames(self) -> Iterator[Frame]:
        """All frames, in order. A number that is left out is of a frame that was not recorded."""
        return self._frames(0)

    def _frames(self, chunk: int) -> Iterator[Frame]:
        for place in range(chunk, len(self._chunks.places)):
            yield from self._frames_in(place)

    def _frames_in(self, chunk: int) -> Iterator[Frame]:
        for _, message in self._chunks.messages_in(chunk, (c.FRAME,)):
            with self._explained(f"frame {message.sequence}"):
                frame = decode_frame(message.data, self._reader, self._seconds(message))
            yield frame

    def strings(self, check: bool = False) -> Iterator[tuple[Frame, Scene]]:
        """Each frame, with the string after it; `check`: compare the digests of all strings."""
        return self._strings(self.description.world.scene, 0, 0, check)

    def string(self, number: int) -> Scene:
        """w of a frame: the string with which it begins. Number 0 is the initial string.

        Raises RecordError where the record does not have it.
        """
        start, scene, chunk = self._key_before(number)
        if start == number:
            return scene
        for frame, after in self._strings(scene, start, chunk, check=False):
            if frame.number == number - 1:
                return after
            if frame.number >= number:
                break
        raise RecordError(f"{self.path}: the string of frame {number} is not in it")

    def play(self, number: int) -> Iterator[tuple[Frame, Scene]]:
        """As `strings`, from the frame of this number on."""
        start, scene, chunk = self._key_before(number)
        for frame, after in self._strings(scene, start, chunk, check=False):
            if frame.number >= number:
                yield frame, after

    # --- where its world can go on ---

    def end(self) -> tuple[Checkpoint, Scene]:
        """The checkpoint after the last whole frame, and the string there. Raises RecordError."""
        number, scene = self.last()
        return self._checkpoint(number), scene

    def last(self) -> tuple[int, Scene]:
        """The number after that of the last whole frame, and the string there."""
        number, scene, chunk = self._key_before(_END)
        for frame, after in self._strings(scene, number, chunk, check=False):
            number, scene = frame.number + 1, after
        return number, scene

    def emitted(self) -> Iterator[tuple[Frame, tuple[AnyEvent, ...] | None]]:
        """Each frame, with what agents sent in it; None where there are no checkpoints."""
        known = c.CHECKPOINT in self._chunks.topics.values()
        step: Step | None = None
        for topic, message in self._chunks.messages((c.CHECKPOINT, c.FRAME)):
            with self._explained(topic):
                if topic == c.CHECKPOINT:
                    step = decode_checkpoint(message.data, self._reader)
                    continue
                frame = decode_frame(message.data, self._reader, self._seconds(message))
            new = step is not None and step.new.frame == frame.number + 1
            sent = step.new.emitted if step is not None and new else ()
            yield frame, sent if known else None

    def _seconds(self, message: Message) -> float:
        return (message.publish_time - self.description.began) / c.NANO

    def _checkpoint(self, number: int) -> Checkpoint:
        found = Checkpoint()
        for step in self._steps(number):
            found = step.after(found)
        if found.frame < number:  # Nothing was new in the last frames, and no events wait.
            found = replace(found, frame=number, emitted=(), inbox={})
        return found

    def _steps(self, number: int) -> list[Step]:
        """The checkpoints up to a frame's, from the last whole one on."""
        found: list[Step] = []
        for chunk in range(len(self._chunks.places) - 1, -1, -1):
            some = list(self._steps_in(chunk, number))
            whole = [place for place, step in enumerate(some) if step.whole]
            found = some[whole[-1] if whole else 0 :] + found
            if whole:
                return found
        if number:
            raise RecordError(f"{self.path}: it has no checkpoints, so nothing can go on from it")
        return found

    def _steps_in(self, chunk: int, number: int) -> Iterator[Step]:
        for _, message in self._chunks.messages_in(chunk, (c.CHECKPOINT,)):
            with self._explained("a checkpoint"):
                if frame_number(message.data) <= number:
                    yield decode_checkpoint(message.data, self._reader)

    def messages(self, number: int) -> Iterator[tuple[str, Message]]:
        """Topic and message of all that happened before a frame, as it is in the file."""
        for topic, message in self._chunks.messages(self._chunks.topics.values()):
            late = {c.CHECKPOINT: number, c.SENSED: number - 1}.get(topic)
            if late is None or message.sequence <= late:
                yield topic, message

    def last_events(self, types: Collection[str]) -> dict[str, tuple[int, tuple[AnyEvent, ...]]]:
        """Of each of these event types the last frame that had some, and all of its events."""
        found: dict[str, tuple[int, tuple[AnyEvent, ...]]] = {}
        for chunk in range(len(self._chunks.places) - 1, -1, -1):
            here: dict[str, tuple[int, tuple[AnyEvent, ...]]] = {}
            for frame in self._frames_in(chunk):
                had = {event.type for event in frame.events}
                here.update((one, (frame.number, frame.events)) for one in had.intersection(types))
            found = here | found
            if found.keys() >= set(types):
                break
        return found

    # --- what else is in it ---

    def log(self) -> Iterator[LogLine]:
        """The log, in order."""
        for time, plain in self._json(c.LOG):
            yield LogLine(time, str(plain.get("name", "")), str(plain.get("message", "")))

    def sensed(self) -> Iterator[tuple[float, Readings | Dropped]]:
        """What came on sensor topics, and when, in seconds of the world's time."""
        for _, message in self._chunks.messages((c.SENSED,)):
            with self._explained("a message of a topic"):
                told = decode_sensed(message.data)
            yield message.log_time / c.NANO, told

    def timings(self) -> Iterator[dict[str, float]]:
        """What was measured of each frame, by name, in seconds; and its number as `frame`."""
        for _, plain in self._json(c.TIMING):
            yield {name: one for name, one in plain.items() if isinstance(one, int | float)}

    def _json(self, topic: str) -> Iterator[tuple[float, dict[str, Any]]]:
        for _, message in self._chunks.messages((topic,)):
            with self._explained(f"a message of {topic}"):
                plain = json.loads(message.data)
            yield message.log_time / c.NANO, plain

    def _strings(
        self, scene: Scene, start: int, chunk: int, check: bool
    ) -> Iterator[tuple[Frame, Scene]]:
        """From the string with which frame `start` begins, which lies in or before a chunk."""
        for frame in self._frames(chunk):
            if frame.number < start:
                continue
            with self._explained(f"frame {frame.number}"):
                scene = edited(scene, frame.edit, self._reader)
            if check and scene.digest != frame.digest:
                raise RecordError(
                    f"{self.path}: frame {frame.number} has left a string of the digest"
                    f" {scene.digest.hex()}; recorded was {frame.digest.hex()}"
                )
            yield frame, scene

    def _key_before(self, number: int) -> tuple[int, Scene, int]:
        """The last whole string at or before a frame: its number, itself, and its chunk."""
        time = c.time_of(number, self.description.world.dt)
        for chunk in range(len(self._chunks.places) - 1, -1, -1):
            place = self._chunks.places[chunk]
            found = self._last_key(chunk, number) if place.first <= time else None
            if found is not None:
                return *found, chunk
        return 0, self.description.world.scene, 0

    def _last_key(self, chunk: int, number: int) -> tuple[int, Scene] | None:
        found: bytes | None = None
        for _, message in self._chunks.messages_in(chunk, (c.STRING,)):
            with self._explained("a string"):
                if frame_number(message.data) <= number:
                    found = message.data
        if found is None:
            return None
        with self._explained("a string"):
            return decode_string(found, self._reader)

    @contextmanager
    def _explained(self, what: str) -> Generator[None]:
        try:
            yield
        except RecordError:
            raise
        except (MinervaError, ValueError) as error:
            raise RecordError(f"{self.path}: {what} cannot be read: {error}") from None
