"""A region's state before a frame, from which another process continues without earlier frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

from minerva_bus.errors import ProtocolError
from minerva_bus.frame.description import World
from minerva_bus.frame.member import Member
from minerva_bus.launch.regions.requests import RegionRequests
from minerva_bus.launch.regions.sending import ParcelSender
from minerva_bus.log.checkpoints import Kept
from minerva_bus.log.entries import EntryDecoder, encode_keyframe
from minerva_bus.regions.balancing import borders_of, moved
from minerva_bus.regions.dividing import NOTHING
from minerva_bus.regions.merging import Units
from minerva_bus.regions.messages import ParcelMessage, parcel_of, to_message
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.partition import Partition
from minerva_bus.regions.places import packed_places, unpacked_places
from minerva_bus.regions.region import Region
from minerva_bus.wire.codec import Decoder, encode
from minerva_bus.wire.limits import ON_DISK
from minerva_bus.wire.plain import as_list, pack, unpack


@dataclass(frozen=True, slots=True)
class RegionCheckpoint:
    """State between `enter` and a frame, as a journal has it.

    `keyframe`: string and checkpoint, as in a record. `places`: of its nodes. `norms`: a parcel
    with what norms know of other regions. `views`: parcels with the latest views of each region.
    `borders`: between regions, if they have moved. `messages`: further plain data of the region's
    process.
    """

    keyframe: bytes
    places: bytes
    norms: bytes
    views: Sequence[Any]
    borders: bytes
    messages: Sequence[Any]

    @staticmethod
    def of(region: Region, messages: Sequence[Any]) -> RegionCheckpoint:
        """The state of a region. Raises TypeError if a generator saves data that are not plain."""
        units, checkpoint = region.units, region.algorithm.checkpoint
        last = region.services.last
        saved = {**checkpoint.saved, **region.homes, **region.services.nearby.left}
        kept = Kept.of(replace(checkpoint, saved=saved))
        keyframe = encode_keyframe(region.frame, units.scene, kept, last)
        norms, number = region.norms, region.number
        views = [
            Parcel(frame, source, number, NOTHING, (), part)
            for frame, parts in region.services.shown.items()
            for source, part in parts.items()
        ]
        views += [
            Parcel(frame, source, number, NOTHING, (), halo=figures)
            for frame, shown in region.services.nearby.views.latest.items()
            for source, figures in shown.items()
        ]
        return RegionCheckpoint(
            keyframe,
            packed_places(units.places),
            encode(to_message(norms)),
            [[parcel.source, encode(to_message(parcel))] for parcel in views],
            borders_of(region.partition),
            messages,
        )

    @staticmethod
    def first(region: Region) -> RegionCheckpoint:
        """The state of a region that has received and sent nothing yet."""
        return RegionCheckpoint.of(region, [[], [], [], [], 0])

    @staticmethod
    def at(region: Region, parcels: ParcelSender, requests: RegionRequests) -> RegionCheckpoint:
        """The state of a region before the frame that begins, and what others may still need."""
        count = region.partition.count
        kept = [each for other in range(count) for each in parcels.outbox.kept_for(other)]
        messages = [
            [[each.target, each.data] for each in kept],
            [[each.source, encode(to_message(each))] for each in region.arrived],
            [encode(report) for _, report in sorted(requests.reports.items())],
            [encode(request) for request in requests.waiting],
            parcels.sent_bytes,
        ]
        return RegionCheckpoint.of(region, messages)

    def encoded(self) -> bytes:
        """The checkpoint as bytes."""
        views, messages = list(self.views), list(self.messages)
        return pack([self.keyframe, self.places, self.norms, views, self.borders, messages])

    @staticmethod
    def decoded(data: bytes) -> RegionCheckpoint:
        """A checkpoint that this program has encoded. Raises ProtocolError."""
        return RegionCheckpoint(*as_list(unpack(data, ON_DISK), "a checkpoint"))

    def region(
        self,
        world: World,
        number: int,
        partition: Partition,
        members: Iterable[Member],
        ahead: int = 0,
    ) -> Region:
        """The region in this state; arguments as of `Region`. Raises ProtocolError."""
        keyframe = EntryDecoder(world.vocabulary).keyframe(self.keyframe)
        if keyframe.checkpoint is None:
            raise ProtocolError("the checkpoint of a region has no state beside its string")
        pieces = keyframe.scene.pieces
        places = unpacked_places(self.places, sum(piece.count for piece in pieces), "places")
        past = replace(world, past=keyframe.checkpoint, shown=keyframe.views)
        decoder = Decoder(world.vocabulary, ON_DISK)

        def parcel(source: int, data: bytes) -> Parcel:
            message = decoder.parcel(data)
            assert isinstance(message, ParcelMessage)
            return parcel_of(message, source, number)

        received = parcel(number, self.norms).norms
        own, present = Units(places, pieces), moved(partition, self.borders)
        region = Region(past, number, present, members, own, received, ahead)
        views = [parcel(source, data) for source, data in self.views]
        for frame, parcels in groupby(views, lambda parcel: parcel.frame):
            region.services.take(frame, [*parcels], again=True)
        return region
