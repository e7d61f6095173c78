"""Writes a record: an MCAP file with our channels, in the order of events."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import IO, Final

from minerva_bus.frame.messages import FrameRecord, Readings
from minerva_bus.frame.stimuli import FrameDone
from minerva_bus.grammar.scene import Scene
from minerva_bus.log import channels as c
from minerva_bus.log.checkpoints import Kept, encode_checkpoint
from minerva_bus.log.deltas import delta_between
from minerva_bus.log.description import Description, encode_description
from minerva_bus.log.display import Display
from minerva_bus.log.entries import encode_frame, encode_inputs, encode_keyframe
from minerva_bus.log.mcap_file import CHUNK, McapFile
from minerva_bus.log.reader import Record
from minerva_bus.log.sensing import decode_sensed, encode_dropped, encode_readings
from minerva_bus.log.showing import encode_log
from minerva_bus.world.operator import PersonOperation

SMALL: Final = CHUNK // 8
"""Maximum bytes of a frame that `idle` encodes."""

KEY_AFTER: Final = 8
"""A keyframe is written when the frames since the last one are this many times as long."""


class RecordWriter:
    """Writes one record. Raises OSError if it cannot be written.

    `stream` is the file, which stays open. Data written before the last `flush` are always
    readable: `kept` of `frames` frames. `past`: a record to continue, which is copied first.
    """

    def __init__(
        self, stream: IO[bytes], description: Description, past: Record | None = None
    ) -> None:
        self.frames: int = 0
        self.kept: int = 0
        self._description = description
        self._file = McapFile(stream, description)
        self._display = Display(self._file, description.world)
        self._scene = description.world.scene
        self._checkpoint: Kept | None = None
        self._since_key = 0
        self._key_bytes = 0
        self._put_description()
        if past is None:
            first, state = description.frame, description.world.past
            self._put_keyframe(first, 0.0, Kept.of(state) if first else None)
            # The parts outside of all agents never change, so their maps are written once.
            self._display.maps()
            self._display.poses(self._scene, first, 0.0)
        else:
            self._copy(past)
        self.flush()

    def _put_description(self) -> None:
        """Write the description, in two chunks: a record cannot be read without it."""
        self._file.put(c.WORLD, encode_description(self._description), 0, 0.0)
        self._file.end_chunk()
        self._file.put(c.WORLD, encode_description(self._description, string=False), 0, 0.0)

    def _copy(self, past: Record) -> None:
        """Copy a record up to the state from which its world resumes, and write that state."""
        end = past.intact_end()
        self._scene = end.scene
        seconds = 0.0
        for topic, message in past.messages(end.number):
            # The description has been written, and the channels for
            # other tools are derived from the rest.
            if topic == c.WORLD or topic not in self._file:
                continue
            log_time, published = message.log_time, message.publish_time
            self._file.copy(topic, message.data, log_time, published, message.sequence)
            self.frames += topic == c.FRAME
            seconds = (published - self._description.began) / c.NANO
            sensed = decode_sensed(message.data) if topic == c.SENSED else None
            if isinstance(sensed, Readings):
                self._display.readings(sensed, message.sequence, seconds)
        checkpoint = None if end.checkpoint is None else Kept.of(end.checkpoint)
        self._put_keyframe(end.number, seconds, checkpoint)

    def frame(
        self,
        record: FrameRecord | FrameDone,
        scene: Scene,
        seconds: float,
        timings: Mapping[str, float],
        checkpoint: Kept | None = None,
    ) -> None:
        """Write a frame; `scene` is the string after it, and `checkpoint` that after it.

        The checkpoint and the inputs are first: a frame that was not cut off then has both.
        """
        number, after = record.frame, record.frame + 1
        data = encode_frame(number, record.events, delta_between(self._scene, scene), scene.digest)
        change = b"" if checkpoint is None else encode_checkpoint(checkpoint, self._checkpoint)
        if change:
            self._file.put(c.CHECKPOINT, change, after, seconds, after)
        if isinstance(record, FrameDone) and record.inputs is not None:
            inputs = encode_inputs(record.inputs.without_replies)
            self._file.put(c.INPUTS, inputs, after, seconds, number)
        self._file.put(c.FRAME, data, after, seconds, number)
        self._file.put(c.TIMING, _timing(number, seconds, timings), after, seconds, number)
        self._scene, self._checkpoint = scene, checkpoint
        self.frames += 1
        self._since_key += len(data) + len(change)
        # Keyframes then take an eighth of the record at most, and a seek reads a bounded amount.
        if self._since_key > KEY_AFTER * self._key_bytes:
            self._put_keyframe(after, seconds, checkpoint)
        self._display.poses(scene, after, seconds)

    def log(self, frame: int, seconds: float, member: str, text: str, warning: bool) -> None:
        """Write a log line during this frame."""
        time = c.time_of(frame, self._description.world.dt)
        self._file.put(c.LOG, encode_log(time, member, text, warning), frame, seconds)

    def noted(self, operation: PersonOperation, seconds: float) -> None:
        """Write what a person did to the world."""
        data = json.dumps(asdict(operation)).encode()
        self._file.put(c.OPERATION, data, operation.frame, seconds, operation.frame)

    def sensed(self, readings: Readings, frame: int, seconds: float) -> None:
        """Write readings of a sensor topic that arrived during this frame."""
        # Readings in step have the time of their frame; free ones that of the frame in progress.
        number = readings.frame if readings.frame >= 0 else frame
        self._file.put(c.SENSED, encode_readings(readings), number, seconds, number)
        self._display.readings(readings, number, seconds)

    def dropped(self, count: int, frame: int, seconds: float) -> None:
        """Write the number of missing messages on topics."""
        self._file.put(c.SENSED, encode_dropped(count), frame, seconds, frame)

    def flush(self) -> None:
        """Write all data to the disk."""
        self._file.flush()
        self.kept = self.frames

    def finish(self) -> None:
        """Write the remaining data and the index."""
        self.flush()
        self._file.finish()

    @property
    def has_room(self) -> bool:
        """Whether a small frame, and a keyframe if one is due, stay in memory."""
        due = self._since_key + SMALL > KEY_AFTER * self._key_bytes
        # The next keyframe is assumed to be as long as the last one.
        keyframe = self._key_bytes if due else 0
        return keyframe <= SMALL and self._file.in_chunk + keyframe < CHUNK - SMALL

    def _put_keyframe(self, frame: int, seconds: float, checkpoint: Kept | None) -> None:
        data = encode_keyframe(frame, self._scene, checkpoint)
        self._file.put(c.KEYFRAME, data, frame, seconds)
        self._since_key, self._key_bytes = 0, len(data)
        self._checkpoint = checkpoint  # The next checkpoint contains changes from this one.


def _timing(frame: int, seconds: float, timings: Mapping[str, float]) -> bytes:
    if timings:
        return json.dumps({"frame": frame, "seconds": seconds, **timings}).encode()
    return b'{"frame": %d, "seconds": %.9f}' % (frame, seconds)
