"""The message that carries a parcel, and the checks of a parcel from another process."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Annotated, ClassVar, Final

import numpy as np

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.schema import Note, Wire
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.scene import Scene
from minerva_bus.regions.merging import PlacedEvent, Units
from minerva_bus.regions.parcel import Parcel, Progress
from minerva_bus.regions.places import Place

_COUNT: Final = np.dtype("<u4")
_NUMBER: Final = np.dtype("<i8")


@dataclass(frozen=True, slots=True)
class ParcelMessage:
    """A parcel without its source and target, which are in its key."""

    WIRE: ClassVar = Wire(
        "parcel",
        ("parcel",),
        "what a region needs of another one's frame",
        max_bytes="message_bytes",
        max_values="answer_values",
        awaited=True,
    )

    frame: int
    string: Annotated[Scene | None, Note("the agents that move, with what surrounds them")]
    places: Annotated[bytes, Note("of the outermost nodes of `string`")]
    events: tuple[AnyEvent, ...]
    senders: Annotated[bytes, Note("the places of the senders of `events`")]
    empty: Annotated[bool, Note("the sender's string is ε")]
    resting: Annotated[bool, Note("its next frame would change nothing")]
    reached: Annotated[tuple[str, ...], Note("agents that have sent `until` in this frame")]
    striving: Annotated[tuple[str, ...], Note("their kinds")]
    left: Annotated[m.Figures, Note("by kind, the number of its agents that have not sent it")]


def to_message(parcel: Parcel) -> ParcelMessage:
    """The message of a parcel."""
    progress, units = parcel.progress, parcel.units
    places = [place for each in parcel.events for place in each.places]
    return ParcelMessage(
        parcel.frame,
        units.scene if units else None,
        packed_places(units.places),
        tuple(each.event for each in parcel.events),
        packed_places(places),
        progress.empty,
        progress.resting,
        tuple(sorted(progress.reached)),
        tuple(sorted(progress.striving)),
        dict(progress.left),
    )


def from_message(message: ParcelMessage, source: int, target: int) -> Parcel:
    """The parcel of a message. Raises ProtocolError if its parts contradict each other."""
    scene = message.string or Scene(())
    nodes = sum(piece.count for piece in scene.pieces)
    places = unpacked_places(message.places, nodes, "places")
    left: dict[str, int] = {}
    for kind, count in message.left.items():
        if type(count) is not int or count < 0:
            raise ProtocolError(f"parcel: left: {kind[:40]} must be a count, not {count!r:.40}")
        left[kind] = count
    progress = Progress(
        message.empty,
        message.resting,
        frozenset(message.reached),
        frozenset(message.striving),
        left,
    )
    events = tuple(placed_events(message.events, message.senders))
    return Parcel(message.frame, source, target, Units(places, scene.pieces), events, progress)


def placed_events(events: Sequence[AnyEvent], senders: bytes) -> Iterable[PlacedEvent]:
    """Events with the places of their senders. Raises ProtocolError if they do not match."""
    counts = [len(event) if isinstance(event, Events) else 1 for event in events]
    places, end = unpacked_places(senders, sum(counts), "senders"), 0
    for event, count in zip(events, counts, strict=True):
        if not (event.senders if isinstance(event, Events) else event.sender):
            raise ProtocolError(f"parcel: the event {event.type} has no sender")
        begin, end = end, end + count
        yield PlacedEvent(places[begin:end], event)


def packed_places(places: Sequence[Place]) -> bytes:
    """The length of each place as uint32, then all numbers as int64, little-endian."""
    if not places:
        return b""
    lengths = np.fromiter(map(len, places), _COUNT, len(places))
    return lengths.tobytes() + np.fromiter(chain.from_iterable(places), _NUMBER).tobytes()


def unpacked_places(data: bytes, count: int, what: str) -> list[Place]:
    """The places of `count` nodes or senders. Raises ProtocolError for other data."""
    begin = count * _COUNT.itemsize
    lengths = np.frombuffer(data[:begin], _COUNT) if len(data) >= begin else None
    # An unsigned sum of numbers below 2^32 does not overflow in Python.
    total = -1 if lengths is None else sum(lengths.tolist())
    if lengths is None or len(data) - begin != total * _NUMBER.itemsize:
        raise ProtocolError(f"parcel: {what} has {len(data)} bytes, which are not {count} places")
    if (lengths % 2 == 0).any():
        raise ProtocolError(f"parcel: {what}: a place must have an odd number of numbers")
    numbers: list[int] = np.frombuffer(data[begin:], _NUMBER).tolist()
    ends = [0, *np.cumsum(lengths, dtype=np.int64).tolist()]
    return [tuple(numbers[first:last]) for first, last in pairwise(ends)]
