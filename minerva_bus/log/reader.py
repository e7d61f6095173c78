"""Reading a record: its frames, and the string of any of them."""

from __future__ import annotations

import json
from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Self, cast

from minerva_bus.errors import MinervaError, ProtocolError
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.messages import Readings
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.checkpoints import Step, decode_checkpoint
from minerva_bus.log.chunks import Chunks, Message
from minerva_bus.log.description import LIMITS, Description, decode_description
from minerva_bus.log.edits import edit_between, edited
from minerva_bus.log.errors import RecordError
from minerva_bus.log.losses import Losses
from minerva_bus.log.messages import (
    Frame,
    decode_frame,
    decode_string,
    encode_frame,
    frame_number,
)
from minerva_bus.log.sensing import Dropped, decode_sensed
from minerva_bus.log.soundness import Sound
from minerva_bus.wire.values import Reader

_END: Final = 1 << 62


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line of the log: when, in seconds of the world's time; about whom, and what."""

    time: float
    member: str
    text: str


def _checkpoint(number: int, steps: list[Step]) -> Checkpoint:
    found = Checkpoint()
    for step in steps:
        found = step.after(found)
    if found.frame < number:  # Nothing was new in the last frames, and no events wait.
        found = replace(found, frame=number, emitted=(), inbox={})
    return found


class Record:
    """A record that is read; also the context in which its file is open.

        with Record(path) as record:
            for frame, string in record.strings():
                ...

    `description` says of which world it is. `complete`: it was closed as it should be; a record
    whose world has crashed has all but what came after the last flush. Where bytes are damaged,
    all else can be used, and `losses` says what cannot. Raises RecordError, here and wherever it is
    read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._chunks = Chunks(path)
        self.complete = self._chunks.complete
        self.size = self._chunks.size
        self._count = len(self._chunks.places)
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
        """What the first of its descriptions that is intact says: there are two."""
        for _, message in self._chunks.messages((c.WORLD,)):
            try:
                told, whole = decode_description(message.data)
                return told if whole else self._with_string(told)
            except (RecordError, ProtocolError) as error:
                raise RecordError(f"{self.path}: {error}") from None
        damage = self._chunks.damage
        why = f" (byte {damage[0].begin:,}: {damage[0].why})" if damage else ""
        raise RecordError(f"{self.path}: it does not say of which world it is{why}")

    def _with_string(self, told: Description) -> Description:
        """The second description leaves the initial string to the message that follows it."""
        reader = Reader(told.world.vocabulary, LIMITS)
        for _, message in self._chunks.messages((c.STRING,)):
            _, scene = decode_string(message.data, reader)
            return replace(told, world=replace(told.world, scene=scene))
        raise RecordError("the string that it begins with is damaged")

    def losses(self) -> Losses:
        """What of it cannot be used. Reads all chunks, but no string that need not be known."""
        sound = self._sound(0, 0)
        for _ in sound.messages(()):
            pass
        open_from = sound.reached if sound.open else None
        damage, cut = tuple(self._chunks.damage), self._chunks.cut
        return Losses(damage, cut, tuple(sound.lost), open_from)

    def _sound(self, begin: int, start: int, end: int | None = None) -> Sound:
        end = self._count if end is None else end
        return Sound(self._chunks, self._whole_string, begin, start, end)

    def _whole_string(self, data: bytes) -> tuple[int, Scene]:
        with self._explained("a string"):
            return decode_string(data, self._reader)

    def frames(self) -> Iterator[Frame]:
        """All frames, in order. A number that is left out is of a frame that was not recorded."""
        for place in range(self._count):
            yield from self._frames_in(place)

    def _frames_in(self, chunk: int) -> Iterator[Frame]:
        for _, message in self._chunks.messages_in(chunk, (c.FRAME,)) or ():
            yield self._frame(message)

    def _frame(self, message: Message) -> Frame:
        with self._explained(f"frame {message.sequence}"):
            return decode_frame(message.data, self._reader, self._seconds(message))

    def strings(self, check: bool = False) -> Iterator[tuple[Frame, Scene]]:
        """Each frame, with the string after it; `check`: compare the digests of all strings.

        Left out is what is damaged, and with it those frames of which the string is not known then.
        """
        return self._strings(self._sound(0, 0), self.description.world.scene, 0, check)

    def string(self, number: int) -> Scene:
        """w of a frame: the string with which it begins. Number 0 is the initial string.

        Raises RecordError where the record does not have it.
        """
        start, scene, chunk = self._key_before(number)
        if start == number:
            return scene
        for frame, after in self._strings(self._sound(chunk, start), scene, start):
            if frame.number == number - 1:
                return after
            if frame.number >= number:
                break
        raise RecordError(f"{self.path}: the string of frame {number} is not in it")

    def play(self, number: int) -> Iterator[tuple[Frame, Scene]]:
        """As `strings`, from the frame of this number on."""
        start, scene, chunk = self._key_before(number)
        for frame, after in self._strings(self._sound(chunk, start), scene, start):
            if frame.number >= number:
                yield frame, after

    # --- where its world can go on ---

    def end(self) -> tuple[Checkpoint, Scene]:
        """The checkpoint after the last whole frame that has one, and the string there.

        Raises RecordError where there are none.
        """
        before = self._count
        while True:
            number, scene, since = self._last(before)
            steps = self._steps(number, since, before)
            if not isinstance(steps, int):
                return _checkpoint(number, steps), scene
            before = steps

    def intact_end(self) -> tuple[int, Scene]:
        """As `end`; where there are no checkpoints, as `last`."""
        try:
            checkpoint, scene = self.end()
        except RecordError:
            return self.last()
        return checkpoint.frame, scene

    def last(self) -> tuple[int, Scene]:
        """The number after that of the last whole frame, and the string there."""
        return self._last(self._count)[:2]

    def _last(self, before: int) -> tuple[int, Scene, int]:
        """As `last` in the chunks before one; and the chunk since which no frame is lost."""
        number, scene, chunk = self._key_before(_END, before)
        sound = self._sound(chunk, number, before)
        for frame, after in self._strings(sound, scene, number):
            number, scene = frame.number + 1, after
        return number, scene, sound.since

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

    def _steps(self, number: int, since: int, before: int) -> list[Step] | int:
        """The checkpoints up to a frame's, from the last whole one on.

        Where some may be lost between the two, the chunk before which that is so.
        """
        found: list[Step] = []
        for chunk in range(before - 1, -1, -1):
            if chunk < since and self._chunks.torn(chunk + 1):
                return chunk + 1
            some = self._steps_in(chunk, number)
            if some is None and chunk < since:
                return chunk
            some = some or []
            whole = [place for place, step in enumerate(some) if step.whole]
            found = some[whole[-1] if whole else 0 :] + found
            if whole:
                return found
        if number:
            raise RecordError(f"{self.path}: it has no checkpoints, so nothing can go on from it")
        return found

    def _steps_in(self, chunk: int, number: int) -> list[Step] | None:
        some = self._chunks.messages_in(chunk, (c.CHECKPOINT,))
        if some is None:
            return None
        with self._explained("a checkpoint"):
            return [
                decode_checkpoint(message.data, self._reader)
                for _, message in some
                if frame_number(message.data) <= number
            ]

    def messages(self, number: int) -> Iterator[tuple[str, Message]]:
        """Topic and message of all that happened before a frame and is intact.

        They are as in the file, but for the first frames after lost ones: what such a frame
        changes is said anew, in the string that the last frame before has left.
        """
        late = {c.CHECKPOINT: number, c.SENSED: number - 1}
        last = 0
        for topic, message, base in self._sound(0, 0).messages(set(self._chunks.topics.values())):
            if message.sequence > late.get(topic, message.sequence):
                continue
            if topic == c.FRAME:
                if message.sequence >= number:
                    return
                if base is not None:
                    message = self._bridged(message, self.string(last), base)
                last = message.sequence + 1
            yield topic, message

    def _bridged(self, message: Message, old: Scene, base: Scene) -> Message:
        frame = self._frame(message)
        with self._explained(f"frame {frame.number}"):
            edit = edit_between(old, edited(base, frame.edit, self._reader))
        data = encode_frame(frame.number, frame.events, edit, frame.digest)
        return replace(message, data=data)

    def last_events(
        self, types: Collection[str], before: int
    ) -> dict[str, tuple[int, tuple[AnyEvent, ...]]]:
        """Of each of these event types the last frame before one that had some, and all events."""
        found: dict[str, tuple[int, tuple[AnyEvent, ...]]] = {}
        for chunk in range(len(self._chunks.places) - 1, -1, -1):
            here: dict[str, tuple[int, tuple[AnyEvent, ...]]] = {}
            for frame in self._frames_in(chunk):
                if frame.number >= before:
                    break
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
                plain: Any = json.loads(message.data)
            if isinstance(plain, dict):
                yield message.log_time / c.NANO, cast("dict[str, Any]", plain)

    def _strings(
        self, sound: Sound, scene: Scene, start: int, check: bool = False
    ) -> Iterator[tuple[Frame, Scene]]:
        """From the string with which frame `start` begins, where `sound` begins or behind that."""
        for _, message, base in sound.messages((c.FRAME,)):
            frame = self._frame(message)
            if frame.number < start:
                continue
            with self._explained(f"frame {frame.number}"):
                scene = edited(scene if base is None else base, frame.edit, self._reader)
            if check and scene.digest != frame.digest:
                raise RecordError(
                    f"{self.path}: frame {frame.number} has left a string of the digest"
                    f" {scene.digest.hex()}; recorded was {frame.digest.hex()}"
                )
            yield frame, scene

    def _key_before(self, number: int, before: int | None = None) -> tuple[int, Scene, int]:
        """The last whole string at or before a frame: its number, itself, and its chunk.

        With `before`, in the chunks before that one.
        """
        time = c.time_of(number, self.description.world.dt)
        for chunk in range((self._count if before is None else before) - 1, -1, -1):
            place = self._chunks.places[chunk]
            found = self._last_key(chunk, number) if place.first <= time else None
            if found is not None:
                return *found, chunk
        return 0, self.description.world.scene, 0

    def _last_key(self, chunk: int, number: int) -> tuple[int, Scene] | None:
        found: bytes | None = None
        for _, message in self._chunks.messages_in(chunk, (c.STRING,)) or ():
            with self._explained("a string"):
                if frame_number(message.data) <= number:
                    found = message.data
        return None if found is None else self._whole_string(found)

    @contextmanager
    def _explained(self, what: str) -> Generator[None]:
        try:
            yield
        except RecordError:
            raise
        except (MinervaError, ValueError, RecursionError) as error:
            raise RecordError(f"{self.path}: {what} cannot be read: {error}") from None
