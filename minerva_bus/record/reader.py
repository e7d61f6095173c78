"""Reading a record: its frames, and the string of any of them."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.scene import Scene
from minerva_bus.protocol.values import Reader
from minerva_bus.record import channels as c
from minerva_bus.record.chunks import Chunks
from minerva_bus.record.description import LIMITS, Description, decode_description
from minerva_bus.record.edits import edited
from minerva_bus.record.errors import RecordError
from minerva_bus.record.messages import Frame, decode_frame, decode_string, frame_number


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
        began = self.description.began
        for _, message in self._chunks.messages((c.FRAME,), chunk):
            seconds = (message.publish_time - began) / c.NANO
            with self._explained(f"frame {message.sequence}"):
                frame = decode_frame(message.data, self._reader, seconds)
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

    def log(self) -> Iterator[LogLine]:
        """The log, in order."""
        for time, plain in self._json(c.LOG):
            yield LogLine(time, str(plain.get("name", "")), str(plain.get("message", "")))

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
