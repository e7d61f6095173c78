"""Journal of a running world: the tail of its log, from which a successor continues.

    file  = entry, entry, ...
    entry = length of the data (4 bytes, big endian), its CRC-32 (4 bytes), data
    data  = ["begin", format, key of the world, epoch]            first
          | keyframe | inputs                                     (entries.py)
          | the description of the run (description.py)           after the first keyframe
          | ["members", [name, ...]] | ["pace", rate, left] | ["waiting", {source: [event, ...]}]

The file begins with a keyframe and has the inputs of each frame since, as received from members, so
a frame costs little more than its bytes. A successor repeats them all. Later keyframes are for
questions about the latest frames, which need not repeat those before. An entry is passed to the
operating system before any message of the next frame is sent, so a killed process loses nothing.
When the inputs have become much longer than the keyframe, a new file with a new keyframe replaces
the journal. A coordinator that still writes to the unlinked file has a successor.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import BusError, Followed
from minerva_bus.files import replacing
from minerva_bus.frame.description import WorldSpec
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.frame.world_state import StateToRecord
from minerva_bus.log.entries import (
    FORMAT,
    EventsBySource,
    Kept,
    encode_inputs,
    encode_keyframe,
    plain_by_source,
)
from minerva_bus.wire.plain import pack
from minerva_bus.wire.vocabulary_codec import plain_vocabulary

REWRITE_RATIO: Final = 8
"""The journal is rewritten when its inputs are this many times as long as its keyframe."""

MIN_REWRITE_BYTES: Final = 1 << 20

KEY_FRAMES: Final = 256
"""Minimum frames between two keyframes."""

KEY_RATIO: Final = 2
"""A keyframe is added when the inputs since the last one are this many times as long."""

HEAD: Final = struct.Struct(">II")
"""Length and checksum before each entry."""


class Journal:
    """Writes the journal of one run. Raises BusError if it cannot be created.

    An existing journal of this name is replaced. `description` is that of the run, as bytes; a
    successor has it already, but other readers need it. All methods raise Followed if another
    coordinator has taken over the journal, and OSError if it cannot be written.
    """

    def __init__(
        self, path: Path, epoch: int, algorithm: StateToRecord, description: bytes = b""
    ) -> None:
        self.path = path
        self._epoch = epoch
        self._description = description
        self._algorithm = algorithm
        self._file = -1
        self._since = self._key_bytes = 0
        # Of the frames since the last keyframe.
        self._key_frames = self._input_bytes = 0
        self._noted: dict[str, list[Any]] = {"members": [[]], "pace": [0.0, None], "waiting": [{}]}
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.rewrite()
        except OSError as error:
            raise BusError(f"{path}: the journal cannot be written: {error.strerror}") from None

    def frame(self, inputs: FrameInputs) -> None:
        """Append the inputs of a frame that has ended."""
        data = encode_inputs(inputs)
        self._put(data)
        self._key_frames += 1
        self._input_bytes += len(data)
        rate, left = self._noted["pace"]
        # A reader deducts the frame in the same way. The frame has consumed the waiting events, so
        # equal ones after it are new and must be noted again.
        self._noted |= {"pace": [rate, left and left - 1], "waiting": [{}]}

    @property
    def is_long(self) -> bool:
        """Whether its inputs have become much longer than its keyframe."""
        # A small world would rewrite its journal every few frames without a minimum.
        return self._since > max(MIN_REWRITE_BYTES, REWRITE_RATIO * self._key_bytes)

    @property
    def is_keyframe_due(self) -> bool:
        """Whether the frames since the last keyframe are many, and long compared with it."""
        return self._key_frames >= KEY_FRAMES and self._input_bytes > KEY_RATIO * self._key_bytes

    def add_keyframe(self) -> None:
        """Append the current state, between two frames."""
        self._put(self._encoded_state())
        self._key_frames = self._input_bytes = 0

    def members(self, names: Iterable[str]) -> None:
        """Note the members that take part."""
        self._note("members", sorted(names))

    def pace(self, rate: float, left: int | None) -> None:
        """Note the pace; `left` is the number of frames allowed after those in the journal."""
        self._note("pace", rate, left)

    def waiting(self, events: EventsBySource) -> None:
        """Note the waiting events after people have sent some."""
        self._note("waiting", plain_by_source(events))

    def _note(self, name: str, *items: Any) -> None:
        """Append an entry, unless the journal has the same one already."""
        if [*items] != self._noted[name]:
            self._noted[name] = [*items]
            self._put(pack([name, *items]))

    def close(self, *, over: bool) -> None:
        """Close the file, and delete it if the world is `over`."""
        if self._file < 0:
            return
        # A successor's journal has the same name and must not be deleted.
        if over and not self._is_followed():
            self.path.unlink(missing_ok=True)
        os.close(self._file)
        self._file = -1

    def rewrite(self) -> None:
        """Replace the journal with one that starts with the current state, between two frames.

        A successor cannot repeat the frames before it.
        """
        if self._file >= 0 and self._is_followed():
            raise Followed(self._complaint())
        old, since = self._file, self._since
        self._since = 0
        try:
            # The new file takes the name only when it is complete: a process that is killed
            # before that leaves the former journal.
            with replacing(self.path, mode=0o600) as file:
                # `replacing` closes its own descriptor when it gives the file its name.
                self._file = os.dup(file.fileno())
                self._put_beginning()
        except BaseException:
            # The former journal is still in place and valid.
            new, self._file, self._since = self._file, old, since
            if new != old:
                os.close(new)
            raise
        self._key_bytes, self._since = self._since, 0
        self._key_frames = self._input_bytes = 0
        if old >= 0:
            os.close(old)

    def _put_beginning(self) -> None:
        algorithm = self._algorithm
        self._put(pack(["begin", FORMAT, key_of(algorithm.world), self._epoch]))
        self._put(self._encoded_state())
        if self._description:
            self._put(self._description)
        # Waiting events are part of the checkpoint.
        for name in ("members", "pace"):
            self._put(pack([name, *self._noted[name]]))

    def _encoded_state(self) -> bytes:
        algorithm = self._algorithm
        checkpoint = algorithm.checkpoint
        kept = Kept.of(checkpoint)
        return encode_keyframe(algorithm.frame, algorithm.scene, kept, algorithm.shown)

    def _put(self, data: bytes) -> None:
        # Checked before each entry: a frozen coordinator that wakes up
        # must not act after its successor.
        if self._key_bytes and self._is_followed():
            raise Followed(self._complaint())
        entry = HEAD.pack(len(data), zlib.crc32(data)) + data
        self._since += len(entry)
        rest = memoryview(entry)
        while rest:
            # A write to a nearly full disk may be partial.
            rest = rest[os.write(self._file, rest) :]

    def _is_followed(self) -> bool:
        return os.fstat(self._file).st_nlink == 0

    def _complaint(self) -> str:
        return (
            f"another coordinator runs the world {self._algorithm.world.name!r} now and writes the"
            f" journal {self.path}; this one (epoch {self._epoch}) stops"
        )


def key_of(world: WorldSpec) -> bytes:
    """Digest of the properties that a world must share with a journal's to continue it."""
    rules = [world.seed, world.dt, list(world.order.types), world.policy.value]
    return blake2b(pack([plain_vocabulary(world.vocabulary), *rules]), digest_size=16).digest()
