"""Journal of a running world: the tail of its log, from which a successor continues.

    file  = entry, entry, ...
    entry = length of the data (4 bytes, big endian), its CRC-32 (4 bytes), data
    data  = ["begin", format, key of the world, epoch]            first
          | keyframe | inputs                                     (entries.py)
          | ["members", [name, ...]] | ["pace", rate, left] | ["waiting", {source: [event, ...]}]

The file has one keyframe and the inputs of each frame since, as received from members, so a frame
costs little more than its bytes. An entry is passed to the operating system before any message of
the next frame is sent, so a killed process loses nothing. When the inputs have become much
longer than the keyframe, a new file with a new keyframe replaces the journal. A coordinator that
still writes to the unlinked file has a successor.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import BusError, Followed, MinervaError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.log.checkpoints import Kept
from minerva_bus.log.entries import (
    FORMAT,
    EntryDecoder,
    EventsBySource,
    Keyframe,
    encode_inputs,
    encode_keyframe,
    plain_by_source,
    unpacked,
)
from minerva_bus.log.errors import RecordError
from minerva_bus.outputs import replacing
from minerva_bus.wire.plain import as_int, as_number, as_text, as_texts, pack
from minerva_bus.wire.vocabulary import plain_vocabulary

FORMATS: Final = (2, FORMAT)
"""Formats that a reader of this version reads."""

REWRITE_RATIO: Final = 8
"""The journal is rewritten when its inputs are this many times as long as its keyframe."""

MIN_REWRITE_BYTES: Final = 1 << 20
_HEAD: Final = struct.Struct(">II")


@dataclass(slots=True)
class Journaled:
    """Contents of a journal: a keyframe, and the inputs and changes since.

    `world`: the world in the state of the keyframe. `inputs`: of each frame since.
    `members`: members that took part, beside those of the world file.
    `rate`, `left`: as in `Pace`; `left` counts the frames allowed after those in the journal.
    `waiting`: events that people sent since the last frame; None means no change.
    `lost`: unreadable bytes at the end, damaged or cut off.
    """

    epoch: int
    world: World
    keyframe: Keyframe
    inputs: list[FrameInputs] = field(default_factory=list[FrameInputs])
    members: frozenset[str] = frozenset()
    rate: float | None = None
    left: int | None = None
    waiting: EventsBySource | None = None
    lost: int = 0


# --- writing ---


class Journal:
    """Writes the journal of one run. Raises BusError if it cannot be created.

    An existing journal of this name is replaced. All methods raise Followed if another coordinator
    has taken over the journal, and OSError if it cannot be written.
    """

    def __init__(self, path: Path, epoch: int, algorithm: FrameAlgorithm) -> None:
        self.path = path
        self._epoch = epoch
        self._algorithm = algorithm
        self._file = -1
        self._since = self._key_bytes = 0
        self._noted: dict[str, list[Any]] = {"members": [[]], "pace": [0.0, None], "waiting": [{}]}
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self.rewrite()
        except OSError as error:
            raise BusError(f"{path}: the journal cannot be written: {error.strerror}") from None

    def frame(self, inputs: FrameInputs) -> None:
        """Append the inputs of a frame that has ended."""
        self._put(encode_inputs(inputs))
        rate, left = self._noted["pace"]
        # A reader deducts the frame in the same way. The frame has consumed the waiting events, so
        # equal ones after it are new and must be noted again.
        self._noted |= {"pace": [rate, left and left - 1], "waiting": [{}]}

    @property
    def is_long(self) -> bool:
        """Whether its inputs have become much longer than its keyframe."""
        # A small world would rewrite its journal every few frames without a minimum.
        return self._since > max(MIN_REWRITE_BYTES, REWRITE_RATIO * self._key_bytes)

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
        old = self._file
        try:
            # The new file takes the name only when it is complete: a process that is killed
            # before that leaves the former journal.
            with replacing(self.path, mode=0o600) as file:
                # `replacing` closes its own descriptor when it gives the file its name.
                self._file = os.dup(file.fileno())
                self._put_beginning()
        except BaseException:
            # The former journal is still in place and valid.
            new, self._file = self._file, old
            if new != old:
                os.close(new)
            raise
        self._key_bytes, self._since = self._since, 0
        if old >= 0:
            os.close(old)

    def _put_beginning(self) -> None:
        algorithm = self._algorithm
        kept = Kept.of(algorithm.checkpoint)
        self._put(pack(["begin", FORMAT, key_of(algorithm.world), self._epoch]))
        self._put(encode_keyframe(algorithm.frame, algorithm.scene, kept, algorithm.shown))
        # Waiting events are part of the checkpoint.
        for name in ("members", "pace"):
            self._put(pack([name, *self._noted[name]]))

    def _put(self, data: bytes) -> None:
        # Checked before each entry: a frozen coordinator that wakes up
        # must not act after its successor.
        if self._key_bytes and self._is_followed():
            raise Followed(self._complaint())
        entry = _HEAD.pack(len(data), zlib.crc32(data)) + data
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


def key_of(world: World) -> bytes:
    """Digest of the properties that a world must share with a journal's to continue it."""
    rules = [world.seed, world.dt, list(world.order.types), world.policy.value]
    return blake2b(pack([plain_vocabulary(world.vocabulary), *rules]), digest_size=16).digest()


# --- reading ---


def read_journal(path: Path, world: World) -> Journaled | None:
    """Contents of a world's journal, or None if there is none.

    Entries after damaged bytes are ignored, because each frame needs the one before. Raises
    RecordError if the journal belongs to another world or its beginning is damaged.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror}") from None
    entries = list(_entries(data))
    try:
        journaled = _journaled(iter(entries), world, path)
    except RecordError:
        raise
    except (MinervaError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise RecordError(f"{path}: this journal is damaged: {error}") from None
    # A new world that replaces a damaged journal would lose its state.
    if journaled is None and data:
        raise RecordError(
            f"{path}: the beginning of this journal is damaged, so its world cannot continue; move"
            " the file away to start from the beginning"
        )
    if journaled is not None:
        journaled.lost = len(data) - sum(_HEAD.size + len(entry) for entry in entries)
    return journaled


def _entries(data: bytes) -> Iterator[bytes]:
    """Entries of a journal up to the first damaged one."""
    begin = 0
    while begin + _HEAD.size <= len(data):
        length, check = _HEAD.unpack_from(data, begin)
        begin += _HEAD.size
        entry = data[begin : begin + length]
        # An empty entry would match zeros on the disk, because the CRC of nothing is zero.
        if not 0 < length == len(entry) or zlib.crc32(entry) != check:
            return
        yield entry
        begin += length


def _journaled(entries: Iterator[bytes], world: World, path: Path) -> Journaled | None:
    first = next(entries, None)
    state = next(entries, None)
    if first is None or state is None:
        return None
    name, version, key, epoch = [*unpacked(first), None, None, None, None][:4]
    if name != "begin" or version not in FORMATS:
        raise RecordError(f"{path}: this version of Minerva Bus cannot read this journal")
    if key != key_of(world):
        raise RecordError(
            f"{path}: this journal belongs to another world, or to other rules; move the file away"
            " to start from the beginning"
        )
    decoder = EntryDecoder(world.vocabulary)
    keyframe = decoder.keyframe(state)
    # Only keyframes of records may lack one.
    if keyframe.checkpoint is None:
        raise RecordError(f"{path}: this journal is damaged: its keyframe has no checkpoint")
    before = replace(world, scene=keyframe.scene, past=keyframe.checkpoint, shown=keyframe.views)
    journaled = Journaled(as_int(epoch, "the epoch"), before, keyframe)
    for entry in entries:
        _take(entry, journaled, decoder)
    return journaled


def _take(entry: bytes, journaled: Journaled, decoder: EntryDecoder) -> None:
    items = unpacked(entry)
    kind = as_text(items[0], "an entry's name")
    if kind in ("inputs", "frame"):
        journaled.inputs.append(decoder.inputs(entry))
        journaled.left = journaled.left and journaled.left - 1
        journaled.waiting = None
    elif kind == "members":
        journaled.members = frozenset(as_texts(items[1], "members"))
    elif kind == "pace":
        journaled.rate = as_number(items[1], "the rate")
        journaled.left = None if items[2] is None else as_int(items[2], "frames")
    elif kind == "waiting":
        journaled.waiting = decoder.events(items[1])


# --- continuing ---


def resume_from(
    journaled: Journaled, algorithm: FrameAlgorithm, watch: Callable[[s.FrameDone], None]
) -> None:
    """Bring the algorithm of a journal's world to the end of its last complete frame.

    `watch` receives each frame since the keyframe. The algorithm then waits for all members that
    took part. Raises ProtocolError.
    """
    for inputs in journaled.inputs:
        for instruction in algorithm.receive(s.Begin(inputs=inputs)):
            if isinstance(instruction, s.FrameDone):
                watch(instruction)
    if journaled.waiting is not None:
        algorithm.wait_with(journaled.waiting)
    # Guests keep their sessions and reconnect by themselves.
    algorithm.expect(journaled.members)
