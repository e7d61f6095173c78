"""The journal of a world: what its coordinator needs to go on where another one was killed.

    file  = entry, entry, ...
    entry = length of the data (4 bytes, big endian), its CRC-32 (4 bytes), data
    data  = ["begin", format, key of the world, epoch]            first of all
          | ["string", string, checkpoint, [view, ...]]          views as on the bus, whole
          | ["frame", number, due, ticked, taken, layout, replies, waiting, people,
             answers, left out]
          | ["members", [name, ...]] | ["pace", rate, left] | ["waiting", {source: [event, ...]}]

A string stands first, then the inputs of each frame since, as members sent it: so a frame costs
little more than its bytes. An entry reaches the system before anything of the next frame is sent;
a killed process loses none. When the frames have become long beside the string, the journal is
written anew, to another file that takes its name: whoever still writes to the one without a name
is a coordinator that another one has followed.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import BusError, Followed, MinervaError
from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.composition import Layout
from minerva_bus.frame.description import World
from minerva_bus.frame.inputs import FrameInputs
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.log.checkpoints import Kept, decode_checkpoint, encode_checkpoint
from minerva_bus.log.description import LIMITS
from minerva_bus.log.errors import RecordError
from minerva_bus.outputs import replacing
from minerva_bus.wire.alphabet import plain_vocabulary
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.plain import as_int, as_list, as_map, as_number, as_text, pack, unpack
from minerva_bus.wire.values import Reader, plain_event, plain_scene

FORMAT: Final = 2
ANEW_AFTER: Final = 8
"""The journal is written anew when its frames are so many times as long as its string."""

LEAST: Final = 1 << 20
_HEAD: Final = struct.Struct(">II")

Waiting = Mapping[str, Sequence[AnyEvent]]


@dataclass(slots=True)
class Journaled:
    """What a journal has: where it begins, and what has happened since.

    `members` took part, beside those that the world file names; `rate` and `left` are as in
    `Pace`, `left` counting the frames that may follow those in the journal. `waiting` are events
    that people sent since the last frame, None: nothing new. `lost` bytes at the end cannot be
    read: they are damaged, or were written when it was cut off.
    """

    epoch: int
    world: World
    views: Sequence[m.ViewShown] = ()
    inputs: list[FrameInputs] = field(default_factory=list[FrameInputs])
    members: frozenset[str] = frozenset()
    rate: float | None = None
    left: int | None = None
    waiting: Waiting | None = None
    lost: int = 0


# --- writing ---


class Journal:
    """Writes the journal of one run. Raises BusError where it cannot be begun.

    `again` is what a journal of this name had before. Every method raises Followed where another
    coordinator writes it now, and OSError where it cannot be written any more.
    """

    def __init__(self, path: Path, epoch: int, algorithm: FrameAlgorithm) -> None:
        self.path = path
        self._epoch = epoch
        self._algorithm = algorithm
        self._file = -1
        self._since = self._string = 0
        self._members: tuple[str, ...] = ()
        self._pace: tuple[float, int | None] = (0.0, None)
        self._waiting: dict[str, list[Any]] = {}
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._begin()
        except OSError as error:
            raise BusError(f"{path}: the journal cannot be written: {error.strerror}") from None

    def frame(self, inputs: FrameInputs) -> None:
        """A frame is over."""
        self._put(_plain_inputs(inputs))
        rate, left = self._pace
        self._pace = rate, left and left - 1
        if self._since > max(LEAST, ANEW_AFTER * self._string):
            self._begin()

    def members(self, names: Iterable[str]) -> None:
        """These take part now."""
        now = tuple(sorted(names))
        if now != self._members:
            self._members = now
            self._put(["members", list(now)])

    def pace(self, rate: float, left: int | None) -> None:
        """People have changed the pace: so many frames are `left` after those in the journal."""
        if (rate, left) != self._pace:
            self._pace = rate, left
            self._put(["pace", rate, left])

    def waiting(self, events: Waiting) -> None:
        """People have sent events, which are among those that wait for a frame."""
        now = _plain_events(events)
        if now != self._waiting:
            self._waiting = now
            self._put(["waiting", now])

    def close(self, *, over: bool) -> None:
        """Nothing more comes; what is `over` need not be gone on with."""
        if self._file < 0:
            return
        if over and not self._is_followed():
            self.path.unlink(missing_ok=True)
        os.close(self._file)
        self._file = -1

    def _begin(self) -> None:
        """Write it anew, from the string of now."""
        if self._file >= 0 and self._is_followed():
            raise Followed(self._complaint())
        old = self._file
        try:
            with replacing(self.path, mode=0o600) as file:
                self._file = os.dup(file.fileno())
                self._put_beginning()
        except BaseException:
            new, self._file = self._file, old
            if new != old:
                os.close(new)
            raise
        self._string, self._since = self._since, 0
        if old >= 0:
            os.close(old)

    def _put_beginning(self) -> None:
        self._put(["begin", FORMAT, key_of(self._algorithm.world), self._epoch])
        self._put(_plain_string(self._algorithm))
        self._put(["members", list(self._members)])
        self._put(["pace", *self._pace])

    def _put(self, plain: list[Any]) -> None:
        if self._string and self._is_followed():
            raise Followed(self._complaint())
        data = pack(plain)
        entry = _HEAD.pack(len(data), zlib.crc32(data)) + data
        self._since += len(entry)
        rest = memoryview(entry)
        while rest:
            rest = rest[os.write(self._file, rest) :]

    def _is_followed(self) -> bool:
        return os.fstat(self._file).st_nlink == 0

    def _complaint(self) -> str:
        return (
            f"another coordinator runs the world {self._algorithm.world.name!r} now: it writes the"
            f" journal {self.path}; this one, of epoch {self._epoch}, stops"
        )


def key_of(world: World) -> bytes:
    """What a world must have in common with a journal's to go on with it, as a digest."""
    rules = [world.seed, world.dt, list(world.order.types), world.policy.value]
    return blake2b(pack([plain_vocabulary(world.vocabulary), *rules]), digest_size=16).digest()


def _plain_string(algorithm: FrameAlgorithm) -> list[Any]:
    checkpoint = encode_checkpoint(Kept.of(algorithm.checkpoint), None)
    views = [encode(view) for view in algorithm.shown]
    return ["string", plain_scene(algorithm.scene), checkpoint, views]


def _plain_inputs(inputs: FrameInputs) -> list[Any]:
    ticked = [
        [name, reply.received or encode(reply)]
        for name, reply in inputs.ticked.items()
        if reply.events or reply.saved is not None
    ]
    replies = [[reply.member, reply.received or encode(reply)] for reply in inputs.replies]
    taken, waiting = _plain_events(inputs.taken), _plain_events(inputs.waiting)
    head = ["frame", inputs.frame, inputs.due, ticked, taken, inputs.layout]
    return [*head, replies, waiting, inputs.people, inputs.answers, inputs.left_out]


def _plain_events(events: Waiting) -> dict[str, list[Any]]:
    return {source: [plain_event(event) for event in some] for source, some in events.items()}


# --- reading ---


def read_journal(path: Path, world: World) -> Journaled | None:
    """What a world's journal has; None where there is none.

    What comes after damaged bytes, or was cut off at its end, is left out: each frame needs those
    before. Raises RecordError where it is of another world, or its beginning is damaged.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror}") from None
    entries = _Entries(data)
    try:
        found = _journaled(iter(entries), world, path)
    except RecordError:
        raise
    except (MinervaError, ValueError, LookupError, TypeError, RecursionError) as error:
        raise RecordError(f"{path}: this journal is broken: {error}") from None
    if found is None and data:
        raise RecordError(
            f"{path}: the beginning of this journal is damaged, so nothing can go on from it; move"
            " it away to begin anew"
        )
    if found is not None:
        found.lost = len(data) - entries.read
    return found


class _Entries:
    """The entries of a journal up to the first that is damaged or cut off; `read` bytes so far."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.read = 0

    def __iter__(self) -> Iterator[list[Any]]:
        data = self._data
        while (entry := _entry(data, self.read)) is not None:
            self.read += _HEAD.size + len(entry)
            yield as_list(unpack(entry, LIMITS), "an entry of a journal")


def _entry(data: bytes, begin: int) -> bytes | None:
    if begin + _HEAD.size > len(data):
        return None
    length, check = _HEAD.unpack_from(data, begin)
    entry = data[begin + _HEAD.size : begin + _HEAD.size + length]
    whole = 0 < length == len(entry)  # The checksum of nothing is zero, as zeros on a disk have it.
    return entry if whole and zlib.crc32(entry) == check else None


def _journaled(entries: Iterator[list[Any]], world: World, path: Path) -> Journaled | None:
    first = next(entries, None)
    string = next(entries, None)
    if first is None or string is None:
        return None
    if first[:2] != ["begin", FORMAT]:
        raise RecordError(f"{path}: this is no journal that this version of Minerva Bus reads")
    if first[2] != key_of(world):
        raise RecordError(
            f"{path}: this is the journal of another world, or of other rules; move it away to"
            " begin anew"
        )
    reader = Reader(world.vocabulary, LIMITS)
    decoder = Decoder(world.vocabulary, LIMITS)
    found = Journaled(as_int(first[3], "the epoch"), _world(string, world, reader))
    views = [decoder.to_member(one) for one in as_list(string[3], "views")]
    found.views = [one for one in views if isinstance(one, m.ViewShown)]
    for entry in entries:
        _take(entry, found, reader, decoder)
    return found


def _world(entry: list[Any], world: World, reader: Reader) -> World:
    past = decode_checkpoint(entry[2], reader).new
    return replace(world, scene=reader.scene(entry[1]), past=past, shown={})


def _take(entry: list[Any], found: Journaled, reader: Reader, decoder: Decoder) -> None:
    kind = as_text(entry[0], "an entry's name")
    if kind == "frame":
        found.inputs.append(_inputs(entry, reader, decoder))
        found.left = found.left and found.left - 1
        found.waiting = None
    elif kind == "members":
        found.members = frozenset(as_text(one, "a name") for one in as_list(entry[1], "members"))
    elif kind == "pace":
        found.rate = as_number(entry[1], "the rate")
        found.left = None if entry[2] is None else as_int(entry[2], "frames")
    elif kind == "waiting":
        found.waiting = _events(entry[1], reader)


def _inputs(entry: list[Any], reader: Reader, decoder: Decoder) -> FrameInputs:
    _, frame, due, ticked, taken, layout, replies, waiting, people, answers, left_out = entry
    ticks = [decoder.from_member(as_text(name, "a name"), data) for name, data in ticked]
    hosts = [decoder.from_member(as_text(name, "a name"), data) for name, data in replies]
    return FrameInputs(
        as_int(frame, "the frame"),
        tuple(as_text(one, "an event type") for one in as_list(due, "types")),
        {one.member: one for one in ticks if isinstance(one, m.TickReply)},
        _events(taken, reader),
        _layout(layout),
        [one for one in hosts if isinstance(one, m.EvolveReply)],
        _events(waiting, reader),
        tuple(as_text(one, "a source") for one in as_list(people, "sources")),
        tuple(as_int(one, "answers") for one in as_list(answers, "answers")),
        tuple(as_text(one, "a fragment") for one in as_list(left_out, "fragments")),
    )


def _events(plain: Any, reader: Reader) -> Waiting:
    return {source: reader.events(some) for source, some in as_map(plain, "events").items()}


def _layout(plain: Any) -> Layout:
    return tuple(
        tuple((as_text(name, "a part"), as_int(rows, "rows")) for name, rows in population)
        for population in as_list(plain, "a layout")
    )


# --- going on ---


def go_on(
    algorithm: FrameAlgorithm, journaled: Journaled, watch: Callable[[s.FrameDone], None]
) -> None:
    """Bring the algorithm of a journal's world to where its last whole frame ended.

    `watch` is shown each frame since the journal's string. Whoever took part is waited for. Raises
    ProtocolError.
    """
    for view in journaled.views:
        algorithm.show_again(view)
    for inputs in journaled.inputs:
        for one in algorithm.feed(inputs):
            if isinstance(one, s.FrameDone):
                watch(one)
    if journaled.waiting is not None:
        algorithm.wait_with(journaled.waiting)
    algorithm.expect(journaled.members)
