"""A record as a run, which can be moved to any of its frames."""

from __future__ import annotations

from collections.abc import Iterator

from minerva_bus.frame.replaying import RecordedFrame
from minerva_bus.grammar.scene import Scene
from minerva_bus.log.messages import Frame
from minerva_bus.log.reader import Record


class Cursor:
    """Frames of a record, one after another. Raises RecordError where they cannot be read."""

    def __init__(self, record: Record) -> None:
        self._record = record
        self.end: int = record.last()[0]
        self._frames: Iterator[tuple[Frame, Scene]] = iter(())
        self.ahead: RecordedFrame | None = None

    def advance(self) -> None:
        """Go on to the next frame."""
        frame, after = next(self._frames, (None, None))
        if frame is None or after is None:
            self.ahead = None
        else:
            self.ahead = RecordedFrame(frame.number, frame.events, after)

    def seek(self, frame: int) -> Scene:
        """Stand before a frame; the string with which it begins. Raises RecordError."""
        scene = self._record.string(frame)
        self._frames = self._record.play(frame)
        self.advance()
        return scene
