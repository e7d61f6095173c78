"""The messages between regions, and the checks of those from another process."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Final, TypeAlias, TypeGuard, cast

import numpy as np

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.schema import Mark, Note, Wire, Within
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.delta import Delta
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.regions.attached import Replies
from minerva_bus.regions.halo_part import NO_HALO, HaloPart
from minerva_bus.regions.kept import checked_texts
from minerva_bus.regions.merging import PlacedEvent, Units
from minerva_bus.regions.norms import NO_NORMS, NormPart
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.place_table import joined
from minerva_bus.regions.places import packed_places, unpacked_places
from minerva_bus.regions.schedule import Schedule
from minerva_bus.regions.views import NO_VIEWS, PlacedSkeleton, ViewPart
from minerva_bus.world.norms import Lately

_COUNT: Final = np.dtype("<u4")
_REGION: Final = np.dtype("<u2")


@dataclass(frozen=True, slots=True)
class ParcelMessage:
    """A parcel without its source and target, which are in its key."""

    WIRE: ClassVar = Wire(
        "parcel",
        ("parcel",),
        "what a region needs of another one's frame",
        max_bytes="answer_bytes",
        max_values="region_values",
        max_rows="answer_rows",
        awaited=True,
    )

    frame: int
    string: Annotated[Scene | None, Note("the agents that move, with what surrounds them")]
    places: Annotated[bytes, Note("of the outermost nodes of `string`")]
    events: tuple[AnyEvent, ...]
    senders: Annotated[bytes, Note("the places of the senders of `events`")]
    views: Annotated[
        Mapping[str, m.Parts],
        Mark.VIEW,
        Note("for region 0: what has changed in the views of the frame"),
    ] = field(default_factory=dict[str, m.Parts])
    view_patches: Annotated[Mapping[str, m.Patches], Within("views")] = field(
        default_factory=dict[str, dict[str, Delta]]
    )
    skeleton: Annotated[
        Scene | None, Mark.SLOTS, Note("of these views; nil: as in the last parcel with views")
    ] = None
    sizes: Annotated[
        bytes, Note("the number of nodes in the string for each piece of `skeleton`")
    ] = b""
    shown: Annotated[bytes, Note("the places of these nodes")] = b""
    halted: Annotated[tuple[str, ...], Note("agents whose actions no device executes")] = ()
    states: Annotated[m.Figures, Note("values of agents that norms name: `#id.attribute`")] = field(
        default_factory=dict[str, bool | int | float | str]
    )
    counts: Annotated[
        m.Saved, Note("by norm and agent of `string`, the frames of acts that norms count")
    ] = None
    sanctions: Annotated[tuple[AnyEvent, ...], Note("of norms, for the next frame")] = ()
    later: Annotated[tuple[AnyEvent, ...], Note("sanctions for the frame after it")] = ()
    postponed: Annotated[tuple[AnyEvent, ...], Note("that count `lag` frames after `events`")] = ()
    postponed_senders: Annotated[bytes, Note("the places of the senders of `postponed`")] = b""
    halo: Annotated[
        m.Parts,
        Mark.VIEW,
        Note(
            "by visual event type, figures of agents near the receiver's cell; by ~type, if they"
            " have changed, the figures outside of agents"
        ),
    ] = field(default_factory=dict[str, Scene])
    halo_places: Annotated[bytes, Note("of the outermost nodes of `halo`, of all types")] = b""
    halo_kept: Annotated[
        m.Figures,
        Note("by service that asks for it, as text, what it has saved of the sender's agents"),
    ] = field(default_factory=dict[str, bool | int | float | str])


@dataclass(frozen=True, slots=True)
class RepliesMessage:
    """Replies of attached services without their source and target, which are in its key."""

    WIRE: ClassVar = Wire(
        "replies",
        ("parcel",),
        "what the services in region 0 have sent for a frame",
        max_bytes="answer_bytes",
        max_values="region_values",
        max_rows="answer_rows",
        awaited=True,
    )

    frame: int
    events: Annotated[m.SentBy, Note("by the name of the service; also of those without events")]
    kept: Annotated[
        m.Figures,
        Note("by service with a halo, as text, what it has saved of agents that have moved"),
    ] = field(default_factory=dict[str, bool | int | float | str])


@dataclass(frozen=True, slots=True)
class AgainMessage:
    """A request of a region that waits for what another one has sent before."""

    WIRE: ClassVar = Wire("again", ("parcel",), "requests what the sender may lack, once more")

    frame: Annotated[int, Note("for which it waits")]


RegionMessage: TypeAlias = ParcelMessage | RepliesMessage | AgainMessage


def to_message(parcel: Parcel | Replies) -> ParcelMessage | RepliesMessage:
    """The message of a parcel, or of replies."""
    if isinstance(parcel, Replies):
        return RepliesMessage(parcel.frame, parcel.events, dict(parcel.kept))
    units, views, halo = parcel.units, parcel.views, parcel.halo
    layout = views.layout
    return ParcelMessage(
        parcel.frame,
        units.scene if units else None,
        packed_places(units.places),
        tuple(each.event for each in parcel.events),
        _senders(parcel.events),
        views.views,
        views.patches,
        None if layout is None else layout.skeleton,
        b"" if layout is None else np.array(layout.sizes, _COUNT).tobytes(),
        b"" if layout is None else packed_places(layout.places),
        views.halted or halo.halted,  # They are equal if both are there.
        dict(parcel.norms.states),
        dict(parcel.norms.counts) or None,
        parcel.norms.sanctions,
        parcel.norms.later,
        tuple(each.event for each in parcel.postponed),
        _senders(parcel.postponed),
        {name: of.scene for name, of in sorted(halo.figures.items())},
        packed_places(joined(of.places for _, of in sorted(halo.figures.items()))),
        dict(halo.kept),
    )


def _senders(events: Iterable[PlacedEvent]) -> bytes:
    return packed_places(joined(each.places for each in events))


def from_message(message: RegionMessage, source: int, target: int) -> Parcel | Replies:
    """The parcel or the replies of a message. Raises ProtocolError if its parts contradict."""
    assert not isinstance(message, AgainMessage)  # It has neither.
    if isinstance(message, RepliesMessage):
        kept = {name: checked_texts(texts) for name, texts in message.kept.items()}
        return Replies(message.frame, source, target, message.events, kept)
    return parcel_of(message, source, target)


def parcel_of(message: ParcelMessage, source: int, target: int) -> Parcel:
    """The parcel of a message. Raises ProtocolError if its parts contradict each other."""
    scene = message.string or Scene(())
    nodes = sum(piece.count for piece in scene.pieces)
    places = unpacked_places(message.places, nodes, "places")
    events = placed_events(message.events, message.senders)
    units = Units(places, scene.pieces)
    postponed = placed_events(message.postponed, message.postponed_senders)
    parts = _views(message), _norms(message), postponed, _halo(message)
    return Parcel(message.frame, source, target, units, events, *parts)


def _halo(message: ParcelMessage) -> HaloPart:
    if not (message.halo or message.halo_places or message.halo_kept):
        return NO_HALO
    sizes = {name: sum(piece.count for piece in of.pieces) for name, of in message.halo.items()}
    places, end = unpacked_places(message.halo_places, sum(sizes.values()), "halo_places"), 0
    halo: dict[str, Units] = {}
    for name, of in sorted(message.halo.items()):
        begin, end = end, end + sizes[name]
        halo[name] = Units(places[begin:end], of.pieces)
    kept = {name: checked_texts(texts) for name, texts in message.halo_kept.items()}
    return HaloPart(halo, kept, message.halted if halo else ())


def check_given_up(given_up: m.Figures) -> None:
    """Raise ProtocolError if the reason of an agent that has given up is not a text."""
    for who, why in given_up.items():
        if not isinstance(why, str):
            raise ProtocolError(f"given_up: expected text for {who[:40]}, not {why!r:.40}")


def _norms(message: ParcelMessage) -> NormPart:
    if not (message.states or message.counts or message.sanctions or message.later):
        return NO_NORMS
    counts = _lately(message.counts or {})
    return NormPart(message.states, counts, message.sanctions, message.later)


def checked_counts(counts: Mapping[str, Any]) -> Mapping[str, Any]:
    """The counts of norms in a report of a region. Raises ProtocolError for other data."""
    broken, lately = (counts.get(name) for name in ("broken", "lately"))
    if not (isinstance(broken, dict) and isinstance(lately, dict)):
        raise ProtocolError("part: counts: expected broken and lately")
    for norm, count in cast("dict[object, object]", broken).items():
        if not (isinstance(norm, str) and type(count) is int):
            raise ProtocolError(f"part: counts: expected a number for {norm!r:.40}")
    return {"broken": broken, "lately": _lately(cast("dict[str, Any]", lately))}


def _lately(given: Mapping[str, Any]) -> Lately:
    lately: Lately = {}
    for norm, of in given.items():
        acts = cast("dict[Any, Any]", of).items() if isinstance(of, dict) else [(None, None)]
        for who, frames in acts:
            if not (isinstance(who, str) and _are_frames(frames)):
                raise ProtocolError(f"counts: {norm[:40]} has no list of frames by agent")
            lately.setdefault(norm, {})[who] = [*frames]
    return lately


def _are_frames(value: object) -> TypeGuard[list[int]]:
    return isinstance(value, list) and all(
        type(frame) is int for frame in cast("list[object]", value)
    )


def _views(message: ParcelMessage) -> ViewPart:
    layout: PlacedSkeleton | None = None
    if message.skeleton is None and not message.views:
        return NO_VIEWS
    if message.skeleton is not None:
        pieces = message.skeleton.pieces
        if len(message.sizes) != len(pieces) * _COUNT.itemsize:
            raise ProtocolError(f"parcel: sizes has no number for each of {len(pieces)} pieces")
        sizes: list[int] = np.frombuffer(message.sizes, _COUNT).tolist()
        for piece, count in zip(pieces, sizes, strict=True):
            if not isinstance(piece, AgentNode) and piece.count != count:
                raise ProtocolError(f"parcel: sizes has {count} for {piece.count} {piece.symbol}")
        places = unpacked_places(message.shown, sum(sizes), "shown")
        layout = PlacedSkeleton(message.skeleton, tuple(sizes), places)
    return ViewPart(message.views, message.view_patches, layout, message.halted)


def placed_events(events: Sequence[AnyEvent], senders: bytes) -> tuple[PlacedEvent, ...]:
    """Events with the places of their senders. Raises ProtocolError if they do not match."""
    if not (events or senders):
        return ()
    counts = [len(event) if isinstance(event, Events) else 1 for event in events]
    places, end = unpacked_places(senders, sum(counts), "senders"), 0
    placed: list[PlacedEvent] = []
    for event, count in zip(events, counts, strict=True):
        if not (event.senders if isinstance(event, Events) else event.sender):
            raise ProtocolError(f"parcel: the event {event.type} has no sender")
        begin, end = end, end + count
        placed.append(PlacedEvent(places[begin:end], event))
    return tuple(placed)


def packed_pairs(targets: Iterable[Sequence[int]]) -> bytes:
    """Source and target of each parcel, of the targets by source, as uint16, little-endian."""
    pairs = [(source, to) for source, each in enumerate(targets) for to in each]
    return np.array(pairs, _REGION).tobytes()


def expected_sources(
    schedule: Schedule, request: m.RegionRequest, target: int
) -> dict[int, list[int]]:
    """By frame, the sources of the parcels to a region that a request lists.

    Raises ProtocolError for a list of other frames than the requested one needs.
    """
    new = schedule.new(request.frame)
    if len(new) != len(request.parcels):
        given = len(request.parcels)
        raise ProtocolError(f"advance: parcels: expected those of {len(new)} frames, not {given}")
    return {
        frame: sources_in(pairs, target) for frame, pairs in zip(new, request.parcels, strict=True)
    }


def sources_in(pairs: bytes, target: int) -> list[int]:
    """The sources of the parcels to a region. Raises ProtocolError for other data."""
    if len(pairs) % (2 * _REGION.itemsize):
        raise ProtocolError(f"advance: parcels: {len(pairs)} bytes are not pairs of uint16")
    table = np.frombuffer(pairs, _REGION).reshape(-1, 2)
    return table[table[:, 1] == target, 0].tolist()
