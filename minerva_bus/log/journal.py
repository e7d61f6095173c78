"""The journal of a running world: the tail of its log, from which a successor continues.

    file  = entry, entry, ...
    entry = length of the data (4 bytes, big endian), its CRC-32 (4 bytes), data
    data  = ["begin", format, key of the world, epoch]            first
          | keyframe | inputs                                     (entries.py)
          | the description of the run                             after the first keyframe
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
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import BusError, Followed, MinervaError, RecordError
from minerva_bus.files import is_stream, read_bytes, replacing
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.stimuli import FrameInputs
from minerva_bus.frame.world_state import StateToRecord, WorldSpec
from minerva_bus.log.entries import (
    FORMAT,
    EntryDecoder,
    EventsBySource,
    Kept,
    Keyframe,
    RecordHeader,
    decode_header,
    encode_inputs,
    encode_keyframe,
    entry_number,
    plain_by_source,
    unpacked,
)
from minerva_bus.wire.plain import as_int, as_map, as_number, as_text, as_texts, pack
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

    def rewrite(self, save: Callable[[], None] = lambda: None) -> None:
        """Replace the journal with one that starts with the current state, between two frames.

        A successor cannot repeat the frames before it, so `save` is called before that.
        """
        old, since = self._file, self._since
        self._since = 0
        try:
            # The new file takes the name only when it is complete: a process that is killed
            # before that leaves the former journal.
            with replacing(self.path, mode=0o600) as file:
                # `replacing` closes its own descriptor when it gives the file its name.
                self._file = os.dup(file.fileno())
                self._put_beginning()
                # Last, because the thread that saves works beside the lines above. It may take so
                # long that a successor has replaced the journal.
                save()
                if old >= 0 and os.fstat(old).st_nlink == 0:
                    raise Followed(self._complaint())
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


# --- reading, for successors and questions about the latest frames ---

DESCRIPTION_AT: Final = 2
"""Index of the description among the entries: after the beginning and the keyframe."""

_KEYFRAME: Final = pack(["keyframe"])[1:]
"""The name of a keyframe's entry, which follows the byte with the number of its items."""


@dataclass(slots=True)
class Journaled:
    """Contents of a journal: a keyframe, by default the first, and the inputs and changes since.

    `world`: the world in the state of the keyframe. `inputs`: of each frame since.
    `members`: members that took part, beside those of the world file.
    `rate`, `left`: as in `Pace`; `left` counts the frames allowed after those in the journal.
    `configured_rate`: the rate with which the run was started; None if the journal lacks it.
    `waiting`: events that people sent since the last frame; None means no change.
    `lost`: unreadable bytes at the end, damaged or cut off.
    """

    epoch: int
    world: WorldSpec
    keyframe: Keyframe
    inputs: list[FrameInputs] = field(default_factory=list[FrameInputs])
    members: frozenset[str] = frozenset()
    rate: float | None = None
    left: int | None = None
    waiting: EventsBySource | None = None
    lost: int = 0
    configured_rate: float | None = None

    def rate_for(self, configured: float) -> float:
        """Rate of a run that continues and is configured with this rate.

        A successor and a run that is started in the same way keep the rate that people have set.
        """
        if self.rate is None or self.configured_rate not in (None, configured):
            return configured
        return self.rate


def read_journal(path: Path, world: WorldSpec) -> Journaled | None:
    """Contents of a world's journal, or None if there is none.

    Entries after damaged bytes are ignored, because each frame needs the one before. Raises
    RecordError if the journal belongs to another world or its beginning is damaged.
    """
    data = _bytes(path)
    entries = list(_entries(data))
    with _explained(path):
        journaled = _journaled(iter(entries), world, path)
    # A new world that replaces a damaged journal would lose its state.
    if journaled is None and data:
        raise RecordError(
            f"{path}: the beginning of this journal is damaged, so its world cannot continue; move"
            " the file away to start from the beginning"
        )
    if journaled is not None:
        journaled.lost = len(data) - sum(HEAD.size + len(entry) for entry in entries)
    return journaled


def keyframes_in(path: Path) -> list[int]:
    """The frames of a journal's keyframes, in order; none if it has no beginning.

    Raises RecordError.
    """
    with _explained(path):
        return [entry_number(entry) for entry in _entries(_bytes(path)) if _is_keyframe(entry)]


def read_described(path: Path, begin: int = 0) -> tuple[RecordHeader, Journaled]:
    """Description and contents of the journal of a world that may be running.

    The contents start at the last keyframe that is not after frame `begin`, or at the first.

    Raises RecordError if there is none, or if it is damaged or has no description.
    """
    entries = list(_entries(_bytes(path)))
    if len(entries) <= DESCRIPTION_AT:
        raise RecordError(f"{path}: there is no journal, or none that can be read")
    with _explained(path):
        description, _ = decode_header(entries[DESCRIPTION_AT])
        later = [n for n in range(DESCRIPTION_AT, len(entries)) if _is_keyframe(entries[n])]
        early = [n for n in later if entry_number(entries[n]) <= begin]
        rest = entries[1:] if not early else entries[early[-1] :]
        journaled = _journaled(iter([entries[0], *rest]), description.world, path)
    assert journaled is not None  # Both entries before the description exist.
    return description, journaled


MAX_JOURNAL_BYTES: Final = 1 << 30


def _bytes(path: Path) -> bytes:
    if is_stream(path):
        raise RecordError(f"{path}: a pipe or device; expected a journal")
    try:
        return read_bytes(path, MAX_JOURNAL_BYTES)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror}") from None


@contextmanager
def _explained(path: Path) -> Generator[None]:
    try:
        yield
    except RecordError:
        raise
    except (MinervaError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise RecordError(f"{path}: this journal is damaged: {error}") from None


def _entries(data: bytes) -> Iterator[bytes]:
    """Entries of a journal up to the first damaged one."""
    begin = 0
    while begin + HEAD.size <= len(data):
        length, check = HEAD.unpack_from(data, begin)
        begin += HEAD.size
        entry = data[begin : begin + length]
        # An empty entry would match zeros on the disk, because the CRC of nothing is zero.
        if not 0 < length == len(entry) or zlib.crc32(entry) != check:
            return
        yield entry
        begin += length


def _is_keyframe(entry: bytes) -> bool:
    # Without unpacking it: a journal has thousands of entries.
    return entry.startswith(_KEYFRAME, 1)


def _journaled(entries: Iterator[bytes], world: WorldSpec, path: Path) -> Journaled | None:
    first = next(entries, None)
    state = next(entries, None)
    if first is None or state is None:
        return None
    name, version, key, epoch = [*unpacked(first), None, None, None, None][:4]
    if name != "begin" or version != FORMAT:
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
    journaled = Journaled(as_int(epoch, "the epoch"), keyframe.begins(world), keyframe)
    for entry in entries:
        _take(entry, journaled, decoder)
    return journaled


def _take(entry: bytes, journaled: Journaled, decoder: EntryDecoder) -> None:
    items = unpacked(entry)
    kind = as_text(items[0], "an entry's name")
    if kind == "inputs":
        journaled.inputs.append(decoder.inputs(entry))
        journaled.left = journaled.left and journaled.left - 1
        journaled.waiting = None
    elif kind == "members":
        journaled.members = frozenset(as_texts(items[1], "members"))
    elif kind == "pace":
        journaled.rate = as_number(items[1], "the rate")
        journaled.left = None if items[2] is None else as_int(items[2], "frames")
    elif kind == "world":
        journaled.configured_rate = as_number(as_map(items[2], "a world")["rate"], "the rate")
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
        algorithm.inbox.replace(journaled.waiting)
    # Guests keep their sessions and reconnect by themselves.
    algorithm.expect(journaled.members)
