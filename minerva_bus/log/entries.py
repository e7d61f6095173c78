"""Entries of a run's log: keyframes, frame inputs and recorded frames, as msgpack.

    keyframe = ["keyframe", number, string, checkpoint, [view, ...]]
    inputs   = ["inputs", number, due, [[member, ticked], ...], {source: [event, ...]}, layout,
                [[member, evolved], ...], {source: [event, ...]}, people, answers, left out]
    frame    = ["frame", number, [event, ...], delta, digest]

A record (MCAP file) and a journal (file of a running coordinator) hold the same entries. A keyframe
is the complete state before the frame of its number: string, checkpoint (checkpoints.py, empty if
unknown) and the last views (journals only; θ computes them again from a record). Inputs are the
messages of members as received from the bus. A journal stores the replies of hosts too, so that a
successor needs no user code. A record stores the result of a frame instead: its ordered events,
the delta of the string (deltas.py) and the digest, 16 bytes, of the string after the frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame.composition import Layout
from minerva_bus.frame.description import WorldSpec
from minerva_bus.frame.inputs import Checkpoint, FrameInputs, RecordedFrame
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.log.checkpoints import Kept, decode_checkpoint, encode_checkpoint, entry_items
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.message_limits import ON_DISK
from minerva_bus.wire.plain import (
    as_bytes,
    as_int,
    as_list,
    as_map,
    as_pairs,
    as_text,
    as_texts,
    pack,
    unpack,
)
from minerva_bus.wire.strings_codec import Reader, plain_event_list, plain_scene

FORMAT: Final = 3
"""Version of these entries, and so of records and journals."""

EventsBySource = Mapping[str, Sequence[AnyEvent]]


@dataclass(frozen=True, slots=True)
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
