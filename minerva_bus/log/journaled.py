"""Reads the journal of a world, and brings a successor's algorithm to the end of it."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from minerva_bus.errors import MinervaError, RecordError
from minerva_bus.files import is_stream, read_bytes
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import WorldSpec
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.log.entries import (
    FORMAT,
    EntryDecoder,
    EventsBySource,
    Keyframe,
    entry_number,
    unpacked,
)
from minerva_bus.log.journal import HEAD, key_of
from minerva_bus.log.record_header import Description, decode_description
from minerva_bus.wire.plain import as_int, as_map, as_number, as_text, as_texts, pack

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


def read_described(path: Path, begin: int = 0) -> tuple[Description, Journaled]:
    """Description and contents of the journal of a world that may be running.

    The contents start at the last keyframe that is not after frame `begin`, or at the first.

    Raises RecordError if there is none, or if it is damaged or has no description.
    """
    entries = list(_entries(_bytes(path)))
    if len(entries) <= DESCRIPTION_AT:
        raise RecordError(f"{path}: there is no journal, or none that can be read")
    with _explained(path):
        description, _ = decode_description(entries[DESCRIPTION_AT])
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
