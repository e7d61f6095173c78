"""Events that all regions need: they travel with reports and requests, not in a parcel for each."""

from __future__ import annotations

from collections.abc import Sequence

from minerva_bus.errors import ProtocolError, SceneError, WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.frame.own_agents import NO_AGENTS, OwnAgents
from minerva_bus.regions.dividing import NOTHING
from minerva_bus.regions.merging import PlacedEvent
from minerva_bus.regions.messages import ParcelMessage, parcel_of, to_message
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.region import Region
from minerva_bus.wire.codec import Decoder, encode


def packed_for_all(region: Region) -> bytes:
    """What all regions need of the last frame of a region, as its report has it."""
    if not region.for_all:
        return b""
    number = region.number
    return encode(
        to_message(Parcel(region.frame - 1, number, number, NOTHING, tuple(region.for_all)))
    )


def unpacked_for_all(
    decoder: Decoder, data: bytes, source: int, frame: int, known: OwnAgents = NO_AGENTS
) -> Sequence[PlacedEvent]:
    """What a region has reported of a frame for all; there may be more for the `known` agents.

    Raises ProtocolError and SceneError for other data.
    """
    if not data:
        return ()
    message = decoder.parcel(data, known)
    if isinstance(message, ParcelMessage):
        parcel = parcel_of(message, source, source)
        only_events = Parcel(frame, source, source, parcel.units, parcel.events)
        if parcel == only_events and not parcel.units:
            return parcel.events
    raise ProtocolError(f"for_all: expected a parcel of frame {frame} with events only")


def needed_by_all(
    decoder: Decoder, request: m.RegionRequest, known: OwnAgents
) -> Sequence[PlacedEvent]:
    """The events in a request that all regions need. Raises WorldStopped for invalid ones."""
    events: list[PlacedEvent] = []
    for source, data in enumerate(request.for_all):
        if not data:  # Most regions have sent nothing.
            continue
        try:
            events += unpacked_for_all(decoder, data, source, request.frame - 1, known)
        except (ProtocolError, SceneError) as error:
            raise WorldStopped(f"region {source} has sent invalid events: {error}") from None
    return events
