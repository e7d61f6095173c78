"""Cursor over a record: the one way to reconstruct the state of a recorded run.

    seek     start at the last keyframe at or before a frame, then apply deltas
    ahead    the next frame: events, digest, and the inputs to feed a frame algorithm with
    advance  apply the delta of the next frame

Playing, recomputing a run, swapping a member, resuming and inspecting all read a record this way;
they differ in their use of the inputs. A successor of a killed coordinator reads a
journal, which has a keyframe and the inputs since; it feeds them to its own algorithm. A cursor
never writes, so several futures can start from one position.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from minerva_bus.frame.inputs import Checkpoint, RecordedFrame
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.checkpoints import Step
from minerva_bus.log.chunks import Message
from minerva_bus.log.entries import Keyframe
from minerva_bus.log.errors import RecordError

if TYPE_CHECKING:
    from minerva_bus.log.reader import Record


@dataclass(frozen=True, slots=True)
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
