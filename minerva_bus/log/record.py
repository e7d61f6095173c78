"""Reads a record: frames, strings, checkpoints and all other channels.

A cursor is the one way to reconstruct the state of a recorded run:

    seek     start at the last keyframe at or before a frame, then apply deltas
    ahead    the next frame: events, digest, and the inputs to feed a frame algorithm with
    advance  apply the delta of the next frame

Playing, recomputing a run, swapping a member, resuming and inspecting all read a record this way;
they differ in their use of the inputs. A successor of a killed coordinator reads a journal, which
has a keyframe and the inputs since; it feeds them to its own algorithm. A cursor never writes, so
several futures can start from one position.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Self, cast

from minerva_bus.errors import DamagedRecordWarning, MinervaError, ProtocolError, RecordError
from minerva_bus.frame.messages import Readings
from minerva_bus.frame.stimuli import Checkpoint, RecordedFrame
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.chunks import Chunks, IntactMessages, Losses, Message
from minerva_bus.log.entries import (
    Dropped,
    EntryDecoder,
    Keyframe,
    RecordHeader,
    Step,
    apply_delta,
    decode_checkpoint,
    decode_header,
    decode_sensed,
    delta_between,
    encode_frame,
    entry_number,
)
from minerva_bus.values import fast_dataclass
from minerva_bus.world.event_collection import collect
from minerva_bus.world.operator import PersonOperation

_END: Final = 1 << 62
"""A number greater than that of any frame."""


@fast_dataclass
class RecordedLine:
    """A line of the world's log: `time` in seconds of world time, the member, and the text."""

    time: float
    member: str
    text: str


class Record:
    """A record opened for reading; also a context manager.

        with Record(path) as record:
            for frame, string in record.strings():
                ...

    `description`: the world, its file and options. `complete`: the run ended normally; otherwise
    the record has everything up to the last flush. Damaged parts are skipped: `losses` lists all
    of them, and at the end the context manager warns of those that it met, with a
    DamagedRecordWarning. A reader that reports `damage` itself sets `reported`. Raises RecordError
    here and in all methods.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._chunks = Chunks(path)
        self.complete = self._chunks.complete
        self.size = self._chunks.size
        self.reported: bool = False
        self._count = len(self._chunks.places)
        try:
            self.description = self._description()
        # Closes the file if the constructor fails.
        except BaseException:
            self.close()
            raise
        self._decoder = EntryDecoder(self.description.world.vocabulary)
        self.initial = Keyframe(self.description.frame, self.description.world.scene)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            if not self.reported and (message := self.damage()):
                warnings.warn(message, DamagedRecordWarning, stacklevel=2)
        finally:
            self.close()

    def close(self) -> None:
        """Close the file."""
        self._chunks.close()

    def _description(self) -> RecordHeader:
        """The first intact description; a record has two."""
        for _, message in self._chunks.messages((c.WORLD,)):
            try:
                description, has_string = decode_header(message.data)
                return description if has_string else self._with_string(description)
            except (RecordError, ProtocolError) as error:
                raise RecordError(f"{self.path}: {error}") from None
        damage = self._chunks.damage
        why = f" (byte {damage[0].begin:,}: {damage[0].why})" if damage else ""
        raise RecordError(f"{self.path}: the description of its world is missing{why}")

    def _with_string(self, description: RecordHeader) -> RecordHeader:
        """Add the initial string, which the second description leaves to the keyframe after it."""
        decoder = EntryDecoder(description.world.vocabulary)
        for _, message in self._chunks.messages((c.KEYFRAME,)):
            scene = decoder.keyframe(message.data).scene
            return replace(description, world=replace(description.world, scene=scene))
        raise RecordError("its initial string is damaged")

    def losses(self) -> Losses:
        """Unusable parts. Reads all chunks, but decodes strings only after damage."""
        intact = self.intact(0, 0)
        for _ in intact.messages(()):
            pass
        open_from = intact.reached if intact.open else None
        damage, cut = tuple(self._chunks.damage), self._chunks.cut
        return Losses(damage, cut, tuple(intact.lost), open_from)

    def damage(self) -> str:
        """What is damaged and lost, in one line; empty if nothing read so far is damaged."""
        # Reads the other chunks only after damage, so that intact records cost nothing.
        return self.losses().message(self.path) if self._chunks.damage else ""

    # --- frames and strings ---

    def frames(self) -> Iterator[RecordedFrame]:
        """All frames in order, without strings. Frames that were not recorded are missing."""
        for chunk in range(self._count):
            yield from self._frames_in(chunk)

    def _frames_in(self, chunk: int) -> Iterator[RecordedFrame]:
        for _, message in self._chunks.messages_in(chunk, (c.FRAME,)) or ():
            yield self.frame(message)

    def strings(self, check: bool = False) -> Iterator[tuple[RecordedFrame, Scene]]:
        """Each frame with the string after it; `check` compares all digests.

        Damaged frames are skipped, and frames whose string is unknown because of them.
        """
        cursor = Cursor(self)
        while (frame := cursor.ahead) is not None:
            scene = cursor.advance()
            if check and scene.digest != frame.digest:
                raise RecordError(
                    f"{self.path}: the digest of the string after frame {frame.number} is"
                    f" {scene.digest.hex()}, but {frame.digest.hex()} was recorded"
                )
            yield frame, scene

    def string(self, number: int) -> Scene:
        """w of a frame: the string with which it begins. Number 0 is the initial string.

        Raises RecordError if the record does not have it.
        """
        return Cursor(self, events=False).seek(number)

    def last(self) -> tuple[int, Scene]:
        """Number of the last intact frame plus one, and the string there."""
        cursor = Cursor(self, events=False)
        cursor.skip_to(_END)
        return cursor.number, cursor.scene

    def closing_events(self) -> tuple[AnyEvent, ...]:
        """What agents and norms sent in the last frame: no frame of the record has these events.

        Nothing if it is unknown, as in a record without checkpoints.
        """
        end = self.intact_end()
        if end.checkpoint is None or end.number != self.last()[0]:
            return ()
        return collect(self.description.world.order, end.checkpoint.sent)

    def end(self) -> tuple[Checkpoint, Scene]:
        """The last known checkpoint, and the string there: a run resumes from this state.

        Raises RecordError for a record without checkpoints.
        """
        end = self.intact_end()
        if end.checkpoint is None:
            raise RecordError(f"{self.path}: it has no checkpoints, so the run cannot be resumed")
        return end.checkpoint, end.scene

    def intact_end(self) -> Keyframe:
        """As `end`, but of a record without checkpoints the state after its last frame."""
        cursor = Cursor(self, state=True)
        before = self._count
        while before:
            keyframe, before = self.keyframe(_END, before)
            cursor.start(keyframe, before)
            # A tear may have made the checkpoints after this keyframe unknown,
            # so an earlier one may be needed.
            known = _last_state(cursor)
            if known is not None:
                return known
        if not cursor.number:
            return replace(self.initial, checkpoint=Checkpoint())
        return Keyframe(*self.last())

    # --- interface of cursors ---

    def keyframe(self, number: int, before: int | None = None) -> tuple[Keyframe, int]:
        """The last keyframe at or before a frame, and its chunk; `before` excludes later chunks."""
        # The scan has the time at which each chunk begins, so later chunks are not unpacked.
        time = c.time_of(number, self.description.world.dt)
        for chunk in range((self._count if before is None else before) - 1, -1, -1):
            early = self._chunks.places[chunk].first <= time
            keyframe = self._last_keyframe(chunk, number) if early else None
            if keyframe is not None:
                return keyframe, chunk
        return self.initial, 0

    def _last_keyframe(self, chunk: int, number: int) -> Keyframe | None:
        last = b""
        for _, message in self._chunks.messages_in(chunk, (c.KEYFRAME,)) or ():
            with self._explained("a keyframe"):
                # Only the number is decoded here; the string of a keyframe may be large.
                if entry_number(message.data) <= number:
                    last = message.data
        return self.decoded_keyframe(last) if last else None

    def intact(self, chunk: int, number: int) -> IntactMessages:
        """The usable messages from a chunk on, in which the string of frame `number` is known."""
        return IntactMessages(self._chunks, self.decoded_keyframe, chunk, number, self._count)

    def decoded_keyframe(self, data: bytes) -> Keyframe:
        """A keyframe from bytes."""
        with self._explained("a keyframe"):
            return self._decoder.keyframe(data)

    def step(self, message: Message) -> Step:
        """A change of the checkpoint."""
        with self._explained("a checkpoint"):
            return decode_checkpoint(message.data, self._decoder.reader)

    def frame(self, message: Message, inputs: bytes = b"", *, events: bool = True) -> RecordedFrame:
        """A frame, with its inputs if their bytes are given, and with its `events` if wanted."""
        with self._explained(f"frame {message.sequence}"):
            seconds = (message.publish_time - self.description.began) / c.NANO
            frame = self._decoder.frame(message.data, seconds, events=events)
            return replace(frame, inputs=self._decoder.inputs(inputs)) if inputs else frame

    def after(self, scene: Scene, frame: RecordedFrame) -> Scene:
        """The string after a frame that begins with `scene`."""
        with self._explained(f"frame {frame.number}"):
            return apply_delta(scene, frame.delta, self._decoder.reader)

    def messages(self, number: int) -> Iterator[tuple[str, Message]]:
        """Topics and messages of all intact data before a frame, for copying.

        Messages are unchanged, except the first frame after lost ones: its delta is computed from
        the string after the last frame before the gap.
        """
        # A checkpoint has the number of the frame after it, other messages that of their own frame.
        late = {c.CHECKPOINT: number, c.SENSED: number - 1, c.INPUTS: number - 1}
        topics = {*self._chunks.topics.values()}
        last = 0
        for topic, message, base in self.intact(0, 0).messages(topics):
            if message.sequence > late.get(topic, message.sequence):
                continue
            if topic == c.FRAME:
                if message.sequence >= number:
                    return
                if base is not None:
                    message = self._bridged(message, self.string(last), base.scene)
                last = message.sequence + 1
            yield topic, message

    def _bridged(self, message: Message, old: Scene, base: Scene) -> Message:
        frame = self.frame(message)
        delta = delta_between(old, self.after(base, frame))
        data = encode_frame(frame.number, frame.events, delta, frame.digest)
        return replace(message, data=data)

    def last_events(
        self, types: Collection[str], before: int
    ) -> dict[str, tuple[int, tuple[AnyEvent, ...]]]:
        """For each event type, the last frame before `before` that has it, and all its events."""
        last: dict[str, tuple[int, tuple[AnyEvent, ...]]] = {}
        # From the end, so that chunks before the last occurrences are not read.
        for chunk in range(self._count - 1, -1, -1):
            here: dict[str, tuple[int, tuple[AnyEvent, ...]]] = {}
            for frame in self._frames_in(chunk):
                if frame.number >= before:
                    break
                present = {event.type for event in frame.events}.intersection(types)
                here.update(dict.fromkeys(present, (frame.number, frame.events)))
            last = here | last
            if last.keys() >= set(types):
                break
        return last

    # --- other channels ---

    def log(self) -> Iterator[RecordedLine]:
        """The log lines, in order."""
        for time, plain in self._json(c.LOG):
            yield RecordedLine(time, str(plain.get("name", "")), str(plain.get("message", "")))

    def operations(self) -> Iterator[PersonOperation]:
        """What people did to the running world, in order."""
        for _, plain in self._json(c.OPERATION):
            frame, texts = plain.get("frame"), ("command", "value", "person")
            if isinstance(frame, int):
                yield PersonOperation(frame, *[str(plain.get(name, "")) for name in texts])

    def sensed(self) -> Iterator[tuple[float, Readings | Dropped]]:
        """Messages on sensor topics with their times, in seconds of world time."""
        for _, message in self._chunks.messages((c.SENSED,)):
            with self._explained("a message of a topic"):
                sensed = decode_sensed(message.data)
            yield message.log_time / c.NANO, sensed

    def timings(self) -> Iterator[dict[str, float]]:
        """Measurements of each frame by name, in seconds; `frame` is its number."""
        for _, plain in self._json(c.TIMING):
            yield {name: value for name, value in plain.items() if isinstance(value, int | float)}

    def _json(self, topic: str) -> Iterator[tuple[float, dict[str, Any]]]:
        for _, message in self._chunks.messages((topic,)):
            with self._explained(f"a message of {topic}"):
                plain: Any = json.loads(message.data)
            if isinstance(plain, dict):
                yield message.log_time / c.NANO, cast("dict[str, Any]", plain)

    @contextmanager
    def _explained(self, what: str) -> Generator[None]:
        try:
            yield
        except RecordError:
            raise
        except (MinervaError, ValueError, RecursionError) as error:
            raise RecordError(f"{self.path}: {what} cannot be read: {error}") from None


def _last_state(cursor: Cursor) -> Keyframe | None:
    """The last position from here on whose checkpoint is known."""
    known: Keyframe | None = None
    while True:
        if cursor.checkpoint is not None:
            known = Keyframe(cursor.number, cursor.scene, cursor.checkpoint)
        if cursor.ahead is None:
            return known
        cursor.advance()


# --- the position in a record ---


@fast_dataclass
class _Ahead:
    """The next frame; `base` is the keyframe before it if frames before it are lost.

    `torn`: bytes are lost between it and the frame before.
    """

    frame: RecordedFrame
    step: Step | None
    base: Keyframe | None
    torn: bool


class Cursor:
    """A position between two frames of a record. Raises RecordError for unreadable data.

    `number` is that of the next frame, `scene` the string before it. With `state`, `checkpoint` is
    the rest of the state, or None if the record does not have it. With `inputs`, frames carry
    the inputs of their members, if recorded. Without `events`, frames have none: for questions
    about strings alone, of which half the time would be spent on events.
    """

    def __init__(
        self, record: Record, *, state: bool = False, inputs: bool = False, events: bool = True
    ) -> None:
        self._record = record
        self._events = events
        self._state = state
        self._topics = {c.FRAME}
        if state:
            self._topics |= {c.CHECKPOINT, c.KEYFRAME}
        if inputs:
            self._topics.add(c.INPUTS)
        # A list, because None is a value that has been read: the end of the record.
        self._ahead: list[_Ahead | None] = []
        self.start(record.initial, 0)

    @property
    def ahead(self) -> RecordedFrame | None:
        """The next frame, or None at the end."""
        ahead = self._peek()
        return None if ahead is None else ahead.frame

    @property
    def end(self) -> int:
        """Number of the last frame plus one."""
        return self._record.last()[0]

    def closing_events(self) -> tuple[AnyEvent, ...]:
        """What agents and norms sent in the last frame of the record."""
        return self._record.closing_events()

    def seek(self, number: int) -> Scene:
        """Move before a frame and return its string. Raises RecordError if it is unknown."""
        self.skip_to(number)
        if self.number != number:
            raise RecordError(
                f"{self._record.path}: the string of frame {number} is not in the record"
            )
        return self.scene

    def skip_to(self, number: int) -> None:
        """Move before the first frame of at least this number."""
        # From the last keyframe, so that at most the frames since then are applied.
        self.start(*self._record.keyframe(number))
        while self.ahead is not None and self.ahead.number < number:
            self.advance()

    def start(self, keyframe: Keyframe, chunk: int) -> None:
        """Move to a keyframe, which is in this chunk of the record."""
        self.number: int = keyframe.number
        self.scene = keyframe.scene
        self.checkpoint: Checkpoint | None = keyframe.checkpoint
        self._intact = self._record.intact(chunk, keyframe.number)
        self._messages: Iterator[tuple[str, Message, Keyframe | None]] = self._intact.messages(
            self._topics
        )
        self._tears: int = 0
        self._ahead.clear()

    def settle(self) -> bool:
        """Move to the beginning of the next frame, over lost ones; False if its string is unknown.

        At the end of the record it is the end of the last frame.
        """
        ahead = self._peek()
        if ahead is not None and ahead.base is not None:
            self.number, self.scene = ahead.base.number, ahead.base.scene
            self.checkpoint = ahead.base.checkpoint
        return ahead is None or ahead.frame.number == self.number

    def advance(self) -> Scene:
        """Move past the next frame and return the string after it."""
        ahead = self._peek()
        if ahead is None:
            raise RecordError(f"{self._record.path}: the record ends before frame {self.number}")
        # After a tear a change of the checkpoint may be missing; the next whole one restores it.
        checkpoint = None if ahead.torn else self.checkpoint
        # Frames before this one are lost, but a keyframe has the state from which it starts.
        if ahead.base is not None:
            self.scene, checkpoint = ahead.base.scene, ahead.base.checkpoint
        self.scene = self._record.after(self.scene, ahead.frame)
        self.number = ahead.frame.number + 1
        self.checkpoint = _checkpoint_after(checkpoint, ahead.step, self.number)
        self._ahead.clear()
        return self.scene

    def _peek(self) -> _Ahead | None:
        """The next frame, read on first use."""
        if not self._ahead:
            self._ahead.append(self._next())
        return self._ahead[0]

    def _next(self) -> _Ahead | None:
        step: Step | None = None
        inputs = b""
        for topic, message, base in self._messages:
            if topic == c.CHECKPOINT:
                step = self._record.step(message)
            elif topic == c.INPUTS:
                inputs = message.data
            elif topic == c.KEYFRAME:
                self._restore(message)
            elif message.sequence < self.number:
                # A keyframe's chunk may begin with earlier frames, which are not decoded.
                step, inputs = None, b""
            else:
                frame = self._record.frame(message, inputs, events=self._events)
                torn, self._tears = self._intact.tears > self._tears, self._intact.tears
                return _Ahead(frame, step, base, torn)
        return None

    def _restore(self, message: Message) -> None:
        """Take the checkpoint of a keyframe at this position, if a tear made it unknown."""
        if self.checkpoint is None:
            keyframe = self._record.decoded_keyframe(message.data)
            if keyframe.number == self.number:
                self.checkpoint = keyframe.checkpoint


def _checkpoint_after(
    before: Checkpoint | None, step: Step | None, number: int
) -> Checkpoint | None:
    """The checkpoint before frame `number`; only changes are recorded."""
    if step is not None and step.new.frame == number:
        if step.whole:
            return step.new
        return None if before is None else step.after(before)
    # Without an entry nothing was saved in the frame, and no event waits.
    return None if before is None else replace(before, frame=number, emitted=(), inbox={})
