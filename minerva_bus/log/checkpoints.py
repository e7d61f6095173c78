"""Checkpoints in a log: the state of a world beside its string, before any frame.

    checkpoint = ["checkpoint", number, whole, {member: saved}, [event, ...],
                  {source: [event, ...]}, [reached, ...], [reaching, ...]]

The number is that of the next frame. The data saved by members (msgpack in bytes) and the agents
that reached `until` are changes since the previous checkpoint; a `whole` one contains everything.
The events wait for the frame: those of agents, then those of other sources. If a frame has no
checkpoint, nothing changed and no events wait.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.inputs import Checkpoint
from minerva_bus.wire.message_limits import ON_DISK
from minerva_bus.wire.plain import (
    as_bool,
    as_bytes,
    as_int,
    as_list,
    as_map,
    as_texts,
    pack,
    unpack,
)
from minerva_bus.wire.strings_codec import Reader, plain_event_list


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
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
