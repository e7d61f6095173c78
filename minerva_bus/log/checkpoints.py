"""Checkpoints in a record: what a world needs beside its string to go on after any frame.

    checkpoint = ["checkpoint", number, whole, {member: saved}, [event, ...],
                  {source: [event, ...]}, [reached, ...], [reaching, ...]]

It belongs to the frame of its number, which comes next. Of what members have saved, as msgpack in
bytes, and of who has reached `until`, there is what is new since the checkpoint before; in a
`whole` one, all. The events are those that wait for the frame: the agents' own, and those of
others. Where there is none for a number, nothing is new, and no events wait.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.wire.limits import ON_DISK
from minerva_bus.wire.plain import as_bool, as_int, as_list, as_map, as_text, pack, unpack
from minerva_bus.wire.values import Reader, plain_event


@dataclass(frozen=True, slots=True)
class Kept:
    """A checkpoint that nobody changes any more: what members have saved is there as bytes."""

    checkpoint: Checkpoint
    saved: Mapping[str, bytes]

    @classmethod
    def of(cls, checkpoint: Checkpoint) -> Kept:
        """Keep a checkpoint as it is now. Raises TypeError for what is no plain data."""
        saved = {name: pack(one) for name, one in checkpoint.saved.items()}
        return cls(replace(checkpoint, saved={}), saved)


@dataclass(frozen=True, slots=True)
class Step:
    """A checkpoint as it was recorded: all of it where it is `whole`, else what is new."""

    whole: bool
    new: Checkpoint

    def after(self, before: Checkpoint) -> Checkpoint:
        """The checkpoint that it makes of the one before."""
        if self.whole:
            return self.new
        return replace(
            self.new,
            saved={**before.saved, **self.new.saved},
            reached=before.reached | self.new.reached,
            reaching=before.reaching | self.new.reaching,
        )


def encode_checkpoint(kept: Kept, before: Kept | None) -> bytes:
    """What is new in a checkpoint as bytes, none where nothing is; all of it where none was before.

    Raises ValueError where what is to be written cannot be.
    """
    new, old = kept.checkpoint, before.checkpoint if before is not None else Checkpoint()
    known: Mapping[str, bytes] = before.saved if before is not None else {}
    saved = {name: data for name, data in kept.saved.items() if known.get(name) != data}
    reached, reaching = _new(new.reached, old.reached), _new(new.reaching, old.reaching)
    if before is not None and not (saved or new.emitted or new.inbox or reached or reaching):
        return b""
    inbox = {source: _plain(events) for source, events in new.inbox.items()}
    items = [new.frame, before is None, saved, _plain(new.emitted), inbox, reached, reaching]
    return pack(["checkpoint", *items])


def decode_checkpoint(data: bytes, reader: Reader) -> Step:
    """A checkpoint from bytes. Raises ProtocolError and VocabularyError."""
    items = as_list(unpack(data, ON_DISK), "a checkpoint")
    if len(items) != 8 or items[0] != "checkpoint":
        raise ProtocolError("a checkpoint has 8 items and begins with its name")
    _, number, complete, saved, emitted, inbox, reached, reaching = items
    new = Checkpoint(
        as_int(number, "the number of a frame"),
        {name: _saved(one) for name, one in as_map(saved, "what members saved").items()},
        reader.events(emitted),
        {source: reader.events(some) for source, some in as_map(inbox, "an inbox").items()},
        _names(reached),
        _names(reaching),
    )
    return Step(as_bool(complete, "whole"), new)


def _new(now: frozenset[str], before: frozenset[str]) -> list[str]:
    return [] if now is before else sorted(now - before)


def _plain(events: Sequence[AnyEvent]) -> list[Any]:
    return [plain_event(event) for event in events]


def _saved(plain: Any) -> Mapping[str, Any]:
    if not isinstance(plain, bytes):
        raise ProtocolError("what a member saved is bytes")
    return as_map(unpack(plain, ON_DISK), "what a member saved")


def _names(plain: Any) -> frozenset[str]:
    names: Iterable[Any] = as_list(plain, "names")
    return frozenset(as_text(one, "a name") for one in names)
