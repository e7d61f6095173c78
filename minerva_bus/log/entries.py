"""Entries of a run's log, as msgpack.

    keyframe   = ["keyframe", number, string, checkpoint, [view, ...]]
    inputs     = ["inputs", number, due, [[member, ticked], ...], {source: [event, ...]}, layout,
                  [[member, evolved], ...], {source: [event, ...]}, people, answers, left out]
    frame      = ["frame", number, [event, ...], delta, digest]
    checkpoint = ["checkpoint", number, whole, {member: saved}, [event, ...],
                  {source: [event, ...]}, [reached, ...], [reaching, ...]]
    topic      = ["topic", name, member, frame, [reading, ...]]     as on the bus (PROTOCOL.md)
               | ["dropped", count]                                 number of missing messages
    world      = ["world", format, {...}]                           the description, before all

    delta      = [step, ...]            along the pieces of the old string
    step       = n                      keep the next n pieces
               | -n                     remove the next n pieces
               | string                 insert these pieces (wire/strings_codec.py)
               | patch                  change the next piece, in columns (wire/columns_codec.py)
               | {"scope": delta}       keep the next piece with a changed scope

A record (MCAP file) and a journal (file of a running coordinator) hold the same entries. A keyframe
is the complete state before the frame of its number: string, checkpoint (empty if unknown) and the
last views (journals only; θ computes them again from a record). Inputs are the messages of members
as received from the bus. A journal stores the replies of hosts too, so that a successor needs no
user code. A record stores the result of a frame instead: its ordered events, the delta of the
string and the digest, 16 bytes, of the string after the frame.

Pieces after the last step of a delta stay. A delta refers to positions, not to fragment names,
because only the coordinator knows which rows of a population a name refers to at a given time. Both
strings share unchanged pieces, so identity is compared and never their contents.

The number of a checkpoint is that of the next frame. The data saved by members (msgpack in bytes)
and the agents that reached `until` are changes since the previous checkpoint; a `whole` one
contains everything. The events wait for the frame: those of agents, then those of other sources. If
a frame has no checkpoint, nothing changed and no events wait. The frame of a `topic` is -1 for
free-running members.
"""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Container, Hashable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from typing import Any, Final, cast

from minerva_bus import __version__
from minerva_bus.errors import MinervaError, ProtocolError, RecordError
from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Layout
from minerva_bus.frame.messages import Readings
from minerva_bus.frame.stimuli import Checkpoint, FrameInputs, RecordedFrame
from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.grammar.columns import difference, patched
from minerva_bus.grammar.events import AnyEvent, Event
from minerva_bus.grammar.scene import EMPTY, AgentNode, Piece, Scene, Scoped, with_scope
from minerva_bus.grammar.types import Unfit
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.columns_codec import is_patch, plain_patch
from minerva_bus.wire.field_codecs import plain_reading, read_reading
from minerva_bus.wire.plain import (
    ON_DISK,
    as_bool,
    as_bytes,
    as_int,
    as_list,
    as_map,
    as_number,
    as_pairs,
    as_text,
    as_texts,
    pack,
    unpack,
)
from minerva_bus.wire.strings_codec import Reader, plain_event, plain_event_list, plain_scene
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.evolution import Policy
from minerva_bus.world.norms import Norm, Then

StringDelta = list[Any]

DEEPEST: Final = 32
"""Nested scopes that a delta enters; a changed scope below that is stored as a whole."""


# --- deltas: computing one ---


def delta_between(old: Scene, new: Scene, depth: int = 0) -> StringDelta:
    """The delta from the old string to the new one."""
    before, after = old.pieces, new.pieces
    same = _same_ahead(before, after)
    counterpart = _counterparts(before, after, same)
    steps = _Steps(same)
    for piece, place in zip(islice(after, same, None), counterpart, strict=True):
        # Its counterpart has been passed, because pieces have
        # changed their order, or there is none.
        if place < steps.at:
            steps.inserted.append(piece)
            continue
        steps.go_to(place)
        if before[place] is piece:
            steps.stay()
        else:
            steps.change(_changed(before[place], piece, depth), piece)
    steps.go_to(len(before))
    return steps.done()


def _counterparts(before: Sequence[Piece], after: Sequence[Piece], same: int) -> Iterator[int]:
    """For each new piece, the position of the old piece it corresponds to, or -1."""
    if len(before) == len(after) and all(
        map(_alike, islice(before, same, None), islice(after, same, None))
    ):
        yield from range(same, len(after))  # The usual case: no piece was added or removed.
        return
    # Shared pieces are matched by identity first, so that they are kept even if others with the
    # same symbol were added before them.
    here = {id(piece): place for place, piece in enumerate(before) if place >= same}
    kept = here.keys() & map(id, islice(after, same, None))
    was = dict(zip(_keys(before, same, kept), range(same, len(before)), strict=True))
    for key, piece in zip(_keys(after, same, kept), islice(after, same, None), strict=True):
        place = here.get(id(piece), -1)
        yield place if place >= 0 else was.get(key, -1)


class _Steps:
    """Collects steps; `at` is the position reached in the old string."""

    def __init__(self, same: int) -> None:
        self.at = same
        self.inserted: list[Piece] = []
        self._made: StringDelta = []
        self._stay, self._gone = same, 0

    def stay(self) -> None:
        """Keep the next piece."""
        if self._gone or self.inserted:
            self._flush()
        self._stay += 1
        self.at += 1

    def go_to(self, place: int) -> None:
        """Remove the pieces before this position."""
        self._gone += place - self.at
        self.at = place

    def change(self, step: Any, piece: Piece) -> None:
        """Change the next piece by this step, or replace it if the step is None."""
        if step is None:
            self.inserted.append(piece)
            self._gone += 1
        else:
            self._flush()
            self._made.append(step)
        self.at += 1

    def done(self) -> StringDelta:
        """Finish and return all steps."""
        if self._gone or self.inserted:
            self._flush()
        return self._made

    def _flush(self) -> None:
        inserted = [plain_scene(Scene(tuple(self.inserted)))] if self.inserted else []
        self._made += [step for step in (self._stay, -self._gone) if step]
        self._made += inserted
        self._stay, self._gone, self.inserted = 0, 0, []


def _same_ahead(before: Sequence[Piece], after: Sequence[Piece]) -> int:
    """Number of identical pieces at the beginning."""
    shorter = min(len(before), len(after))
    if before is after:
        return shorter
    pairs = zip(before, after, strict=False)
    return next((at for at, (old, new) in enumerate(pairs) if old is not new), shorter)


def _alike(old: Piece, new: Piece) -> bool:
    """Whether these are the same piece, or versions of the same agent or symbol."""
    if old is new:
        return True
    if isinstance(old, AgentNode) and isinstance(new, AgentNode):
        return old.id == new.id
    return type(old) is type(new) and old.symbol == new.symbol


def _keys(pieces: Sequence[Piece], begin: int, kept: Container[int]) -> Iterator[Hashable]:
    """Key of each piece: an agent's id, or a symbol and its ordinal.

    Pieces that both strings share have the key None.
    """
    seen: Counter[str] = Counter()
    for piece in islice(pieces, begin, None):
        if id(piece) in kept:
            yield None
        elif isinstance(piece, AgentNode):
            yield piece.id
        else:
            seen[piece.symbol] += 1
            yield piece.symbol, seen[piece.symbol]


def _changed(old: Piece, new: Piece, depth: int) -> Any:
    """The step from the old piece to the new one; None if the new piece must be inserted."""
    if type(old) is AgentNode and type(new) is AgentNode and old.values is not new.values:
        return None  # The usual change: other attribute values.
    patch = difference(old, new)
    if patch is not None:
        return plain_patch(patch)
    # Bounded, because deltas of scopes are computed and applied recursively.
    if not isinstance(old, Scoped) or not isinstance(new, Scoped) or depth >= DEEPEST:
        return None
    if type(old) is not type(new) or old.symbol != new.symbol or old.values is not new.values:
        return None
    return {"scope": delta_between(old.scope, new.scope, depth + 1)}


# --- deltas: applying one ---


def apply_delta(old: Scene, plain: Any, reader: Reader, depth: int = 0) -> Scene:
    """The new string. Raises ProtocolError and VocabularyError if the delta does not fit."""
    if depth > DEEPEST:
        raise ProtocolError(f"a delta goes more than {DEEPEST} scopes deep")
    steps = as_list(plain, "a delta")
    if not steps:
        return old
    left = iter(old.pieces)
    made: list[Piece] = []
    for step in steps:
        if type(step) is int:
            # A step beyond the string is an error and not ignored: the delta is for another string.
            passed = _next(left, abs(step))
            made += passed if step > 0 else []
        elif is_patch(step):
            made.append(_patched(_next(left, 1)[0], step, reader))
        elif isinstance(step, list):
            made += reader.scene(step).pieces
        else:
            made.append(_rescoped(_next(left, 1)[0], step, reader, depth))
    made += left
    return Scene(tuple(made)) if made else EMPTY


def _next(left: Iterator[Piece], count: int) -> list[Piece]:
    pieces = list(islice(left, count))
    if not pieces or len(pieces) < count:
        raise ProtocolError("a delta goes beyond its string")
    return pieces


def _patched(piece: Piece, plain: Any, reader: Reader) -> Piece:
    try:
        return patched(piece, reader.patch(plain))
    except (Unfit, IndexError) as error:
        raise ProtocolError(f"a patch does not fit: {error}") from None


def _rescoped(piece: Piece, step: Any, reader: Reader, depth: int) -> Piece:
    if not isinstance(step, dict) or list(cast("dict[Any, Any]", step)) != ["scope"]:
        raise ProtocolError("a step of a delta is a number, a string, a patch or a scope")
    if not isinstance(piece, Scoped):
        raise ProtocolError("a delta enters a piece without a scope")
    delta = cast("dict[str, Any]", step)["scope"]
    return with_scope(piece, apply_delta(piece.scope, delta, reader, depth + 1))


# --- checkpoints ---


@fast_dataclass
class Kept:
    """An immutable copy of a checkpoint; data saved by members are encoded."""

    checkpoint: Checkpoint
    saved: Mapping[str, bytes]

    @classmethod
    def of(cls, checkpoint: Checkpoint) -> Kept:
        """Copy a checkpoint. Raises TypeError for data that are not plain."""
        # Encoded at once: the data are written later, in another thread,
        # and bytes show what has changed.
        saved = {name: pack(data) for name, data in checkpoint.saved.items()}
        return cls(replace(checkpoint, saved={}), saved)


@fast_dataclass
class Step:
    """A recorded checkpoint: everything if `whole`, otherwise the changes."""

    whole: bool
    new: Checkpoint

    def after(self, before: Checkpoint) -> Checkpoint:
        """The checkpoint after this step."""
        if self.whole:
            return self.new
        return replace(
            self.new,
            saved={**before.saved, **self.new.saved},
            reached=before.reached | self.new.reached,
            reaching=before.reaching | self.new.reaching,
        )


def encode_checkpoint(kept: Kept, before: Kept | None) -> bytes:
    """Changes of a checkpoint as bytes, possibly empty; everything if `before` is None.

    Raises ValueError for data that cannot be encoded.
    """
    new, old = kept.checkpoint, before.checkpoint if before is not None else Checkpoint()
    known: Mapping[str, bytes] = before.saved if before is not None else {}
    saved = {name: data for name, data in kept.saved.items() if known.get(name) != data}
    reached, reaching = _new(new.reached, old.reached), _new(new.reaching, old.reaching)
    # Most frames change nothing here; a missing entry means no change.
    if before is not None and not (saved or new.emitted or new.inbox or reached or reaching):
        return b""
    inbox = {source: plain_event_list(events) for source, events in new.inbox.items()}
    head = ["checkpoint", new.frame, before is None, saved, plain_event_list(new.emitted)]
    return pack([*head, inbox, reached, reaching])


def decode_checkpoint(data: bytes, reader: Reader) -> Step:
    """A checkpoint from bytes. Raises ProtocolError and VocabularyError."""
    items = entry_items(data, 8, "checkpoint")
    number, complete, saved, emitted, inbox, reached, reaching = items
    new = Checkpoint(
        as_int(number, "the number of a frame"),
        {name: _saved(data) for name, data in as_map(saved, "saved data").items()},
        reader.events(emitted),
        {source: reader.events(sent) for source, sent in as_map(inbox, "an inbox").items()},
        frozenset(as_texts(reached, "agents")),
        frozenset(as_texts(reaching, "kinds")),
    )
    return Step(as_bool(complete, "whole"), new)


def entry_items(data: bytes, count: int, name: str) -> list[Any]:
    """The items of an entry after its name. Raises ProtocolError."""
    items = as_list(unpack(data, ON_DISK), "an entry")
    if len(items) != count or items[0] != name:
        raise ProtocolError(f"{name}: expected {count} items that begin with this name")
    return items[1:]


def _new(now: frozenset[str], before: frozenset[str]) -> list[str]:
    return [] if now is before else sorted(now - before)  # Usually nothing has changed.


def _saved(plain: Any) -> Mapping[str, Any]:
    what = "saved data of a member"
    return as_map(unpack(as_bytes(plain, what), ON_DISK), what)


FORMAT: Final = 3
"""Version of these entries, and so of records and journals."""

EventsBySource = Mapping[str, Sequence[AnyEvent]]


# --- keyframes, inputs and frames ---


@fast_dataclass
class Keyframe:
    """Complete state before the frame `number`.

    `checkpoint` is None in a record without checkpoints.
    """

    number: int
    scene: Scene
    checkpoint: Checkpoint | None = None
    views: Sequence[m.ViewShown] = ()

    def begins(self, world: WorldSpec) -> WorldSpec:
        """A world that begins in this state, which has a checkpoint."""
        assert self.checkpoint is not None
        return replace(world, scene=self.scene, past=self.checkpoint, shown=self.views)


# --- encoding ---


def encode_keyframe(
    number: int, scene: Scene, kept: Kept | None, views: Sequence[m.ViewShown] = ()
) -> bytes:
    """A keyframe as bytes."""
    checkpoint = b"" if kept is None else encode_checkpoint(kept, None)
    shown = [encode(view) for view in views]
    return pack(["keyframe", number, plain_scene(scene), checkpoint, shown])


def encode_inputs(inputs: FrameInputs) -> bytes:
    """Frame inputs as bytes. Replies received over the bus are not encoded again."""
    ticked = [
        [name, reply.received or encode(reply)]
        for name, reply in inputs.ticked.items()
        # An empty reply has no effect on the frame, and most replies are empty.
        if reply.events or reply.saved is not None
    ]
    # In an in-process run messages are objects, so there are no received bytes.
    replies = [[reply.member, reply.received or encode(reply)] for reply in inputs.replies]
    taken, waiting = plain_by_source(inputs.taken), plain_by_source(inputs.waiting)
    head = ["inputs", inputs.frame, inputs.due, ticked, taken, inputs.layout]
    return pack([*head, replies, waiting, inputs.people, inputs.answers, inputs.left_out])


def encode_frame(number: int, events: Sequence[AnyEvent], delta: list[Any], digest: bytes) -> bytes:
    """A recorded frame as bytes."""
    return pack(["frame", number, plain_event_list(events), delta, digest])


def plain_by_source(events: EventsBySource) -> dict[str, list[Any]]:
    """Events by source as plain data."""
    return {source: plain_event_list(sent) for source, sent in events.items()}


# --- decoding ---


class EntryDecoder:
    """Decodes entries over a vocabulary. Raises ProtocolError and VocabularyError."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.reader = Reader(vocabulary, ON_DISK)
        self._decoder = Decoder(vocabulary, ON_DISK)

    def keyframe(self, data: bytes) -> Keyframe:
        """A keyframe from bytes."""
        number, scene, saved, views = entry_items(data, 5, "keyframe")
        # A keyframe contains a whole checkpoint, so nothing before it is needed.
        checkpoint = None
        if saved:
            checkpoint = decode_checkpoint(as_bytes(saved, "a checkpoint"), self.reader).new
        decoded = [self._decoder.to_member(view) for view in as_list(views, "views")]
        return Keyframe(
            _number(number),
            self.reader.scene(scene),
            checkpoint,
            [view for view in decoded if isinstance(view, m.ViewShown)],
        )

    def frame(self, data: bytes, seconds: float, *, events: bool = True) -> RecordedFrame:
        """A recorded frame; `seconds` is its time by the clock since the record began.

        Without `events` it has none, which takes about half the time.
        """
        number, sent, delta, digest = entry_items(data, 5, "frame")
        read, step = self.reader.events(sent) if events else (), as_list(delta, "a delta")
        return RecordedFrame(_number(number), read, step, as_bytes(digest, "a digest"), seconds)

    def inputs(self, data: bytes) -> FrameInputs:
        """The inputs of a frame."""
        items = entry_items(data, 11, "inputs")
        number, due, ticked, taken, layout, replies, waiting, people, answers, left_out = items
        return FrameInputs(
            _number(number),
            as_texts(due, "event types"),
            {
                reply.member: reply
                for reply in self._received(ticked, "tick replies")
                if isinstance(reply, m.TickReply)
            },
            self.events(taken),
            _layout(layout),
            [
                reply
                for reply in self._received(replies, "replies")
                if isinstance(reply, m.EvolveReply)
            ],
            self.events(waiting),
            as_texts(people, "sources"),
            tuple(as_int(count, "replies") for count in as_list(answers, "counts of replies")),
            as_texts(left_out, "fragments"),
        )

    def _received(self, plain: Any, what: str) -> list[m.FromMember]:
        return [
            self._decoder.from_member(as_text(name, "a name"), sent)
            for name, sent in as_pairs(plain, what)
        ]

    def events(self, plain: Any) -> EventsBySource:
        """Events by source."""
        return {
            source: self.reader.events(sent) for source, sent in as_map(plain, "events").items()
        }


def entry_number(data: bytes) -> int:
    """Number of the frame of an entry. Raises ProtocolError."""
    items = unpacked(data)
    return _number(items[1] if len(items) > 1 else None)


def unpacked(data: bytes) -> list[Any]:
    """The items of an entry. Raises ProtocolError."""
    return as_list(unpack(data, ON_DISK), "an entry")


def _layout(plain: Any) -> Layout:
    return tuple(
        tuple(
            (as_text(name, "a fragment"), as_int(rows, "rows"))
            for name, rows in as_pairs(population, "the parts of a population")
        )
        for population in as_list(plain, "a layout")
    )


def _number(plain: Any) -> int:
    return as_int(plain, "the number of a frame")


# --- readings on topics ---


@fast_dataclass
class Dropped:
    """Number of messages on topics that arrived faster than they could be written."""

    count: int


def encode_readings(message: Readings) -> bytes:
    """Readings of a topic as bytes."""
    readings = [plain_reading(reading) for reading in message.readings]
    return pack(["topic", message.topic, message.member, message.frame, readings])


def encode_dropped(count: int) -> bytes:
    """A number of missing messages as bytes."""
    return pack(["dropped", count])


def decode_sensed(data: bytes) -> Readings | Dropped:
    """A message of the channel of topics. Raises ProtocolError."""
    items = as_list(unpack(data, ON_DISK), "a message of a topic")
    if items[:1] == ["dropped"] and len(items) == 2:
        return Dropped(as_int(items[1], "a count"))
    if items[:1] != ["topic"] or len(items) != 5:
        raise ProtocolError("a message of a topic has 5 items and begins with its name")
    readings = tuple([read_reading(reading) for reading in as_list(items[4], "readings")])
    return Readings(
        as_text(items[2], "a member"),
        as_text(items[1], "a topic"),
        as_int(items[3], "the frame", -1),
        readings,
    )


# --- the description of a world ---

_LEAST: Final = -(1 << 63)


def versions() -> dict[str, str]:
    """Versions that the digests of a run depend on: platform and libraries."""
    installed = {
        "minerva-bus": __version__,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
    }
    for package in ("eclipse-zenoh", "msgpack", "numpy", "pymunk", "mcap"):
        if (number := _installed_version(package)) is not None:
            installed[package] = number
    return installed


@cache  # Each call reads and parses a file, and several parts of a process describe its world.
def _installed_version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@fast_dataclass
class RecordHeader:
    """A world, the text and path of its file, its options, and the versions it ran on.

    `rate`: frames per second; 0 means as fast as possible. `began`: nanoseconds since 1970.
    `frame`: the frame that begins with the world's string; not 0 in a record that lacks the frames
    before it.
    """

    world: WorldSpec
    file: str = ""
    rate: float = 0.0
    options: Mapping[str, str] = field(default_factory=dict[str, str])
    versions: Mapping[str, str] = field(default_factory=versions)
    began: int = 0
    path: str = ""
    frame: int = 0


def encode_header(description: RecordHeader, *, string: bool = True) -> bytes:
    """A description as bytes; without `string`, it has nil instead of the string."""
    world = description.world
    plain = {
        "name": world.name,
        "vocabulary": plain_vocabulary(world.vocabulary),
        # The second copy of the description omits it: the first keyframe contains it, too.
        "string": plain_scene(world.scene) if string else None,
        "seed": world.seed,
        "dt": world.dt,
        "order": list(world.order.types),
        "policy": world.policy.value,
        "frames": world.frames,
        "until": world.until,
        "give_up": world.give_up,
        "expected": sorted(world.expected),
        "speaks_for": {name: list(kinds) for name, kinds in world.speaks_for.items()},
        "shares": dict(world.shares),
        "norms": [plain_norm(norm) for norm in world.norms],
        "file": description.file,
        "rate": description.rate,
        "options": dict(description.options),
        "versions": dict(description.versions),
        "began": description.began,
        "path": description.path,
        "frame": description.frame,
    }
    return pack(["world", FORMAT, plain])


def decode_header(data: bytes) -> tuple[RecordHeader, bool]:
    """A description, and whether it includes the initial string. Raises RecordError."""
    try:
        items = as_list(unpack(data, ON_DISK), "a description")
        if len(items) != 3 or items[0] != "world":
            raise ProtocolError('a description is ["world", format, {...}]')
        if items[1] != FORMAT:
            raise RecordError(
                f"its format is {items[1]!r}; this version of Minerva Bus reads {FORMAT}:"
                " read it with the version that wrote it"
            )
        plain = as_map(items[2], "a description")
        return _description(plain), plain["string"] is not None
    except KeyError as missing:
        raise RecordError(f"its description lacks {missing}") from None
    except RecordError:
        raise
    except (MinervaError, ValueError, RecursionError) as error:
        raise RecordError(f"its description is wrong: {error}") from None


def _description(plain: Mapping[str, Any]) -> RecordHeader:
    vocabulary = read_vocabulary(plain["vocabulary"])
    reader = Reader(vocabulary, ON_DISK)
    world = WorldSpec(
        name=as_text(plain["name"], "the name"),
        scene=EMPTY if plain["string"] is None else reader.scene(plain["string"]),
        vocabulary=vocabulary,
        seed=as_int(plain["seed"], "the seed", _LEAST),
        dt=as_number(plain["dt"], "dt"),
        order=Priority(as_texts(plain["order"], "order")),
        policy=Policy(as_text(plain["policy"], "the policy")),
        frames=as_int(plain["frames"], "frames"),
        until=as_text(plain["until"], "until"),
        give_up=as_text(plain["give_up"], "give_up"),
        expected=frozenset(as_texts(plain["expected"], "expected")),
        norms=read_norms(plain["norms"], reader),
        speaks_for={
            name: as_texts(kinds, "speaks_for")
            for name, kinds in as_map(plain["speaks_for"], "speaks_for").items()
        },
        shares=_pairs(plain.get("shares", {}), "shares"),  # Earlier records have none.
    )
    return RecordHeader(
        world,
        as_text(plain["file"], "the world file"),
        as_number(plain["rate"], "the rate"),
        _pairs(plain["options"], "an option"),
        _pairs(plain["versions"], "a version"),
        as_int(plain["began"], "the beginning"),
        as_text(plain["path"], "the path"),
        frame=as_int(plain["frame"], "the frame"),
    )


def _pairs(plain: Any, what: str) -> dict[str, str]:
    return {name: as_text(value, what) for name, value in as_map(plain, what).items()}


# --- norms ---


def plain_norm(norm: Norm) -> dict[str, Any]:
    """A norm as plain data."""
    return {
        "name": norm.name,
        "applies": list(norm.applies),
        "on": list(norm.on),
        "when": norm.when,
        "where": norm.where,
        "most": norm.most,
        "per": norm.per,
        "then": norm.then.value,
        "sanction": None if norm.sanction is None else plain_event(norm.sanction),
    }


def read_norms(plain: Any, reader: Reader) -> tuple[Norm, ...]:
    """Norms from plain data. Raises ProtocolError, VocabularyError and ValueError."""
    return tuple([_norm(as_map(norm, "a norm"), reader) for norm in as_list(plain, "norms")])


def _norm(plain: dict[str, Any], reader: Reader) -> Norm:
    sanction = None if plain["sanction"] is None else reader.event(plain["sanction"])
    if sanction is not None and not isinstance(sanction, Event):
        raise ProtocolError("a sanction is one event")
    return Norm(
        as_text(plain["name"], "a norm's name"),
        as_texts(plain["applies"], "applies"),
        as_texts(plain["on"], "on"),
        as_text(plain["when"], "when"),
        as_text(plain["where"], "where"),
        as_int(plain["most"], "most"),
        as_int(plain["per"], "per", 1),
        Then(as_text(plain["then"], "then")),
        sanction,
    )
