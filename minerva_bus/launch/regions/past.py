"""What a former process of a region has run: the frames that the next process repeats first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

from minerva_bus.errors import WorldStopped
from minerva_bus.frame import messages as m
from minerva_bus.launch.failures import own_members
from minerva_bus.launch.regions.checkpoint import RegionCheckpoint
from minerva_bus.launch.regions.frames import RegionFrames
from minerva_bus.launch.regions.journal import MAX_BYTES
from minerva_bus.launch.regions.sending import KeptMessage
from minerva_bus.regions.journal import CHECKPOINT, COORDINATOR
from minerva_bus.regions.messages import from_message
from minerva_bus.runtime.region_links import ParcelArrived
from minerva_bus.wire.codec import Decoder
from minerva_bus.wire.limits import ON_DISK


class RegionPast:
    """The entries of the journal of a region that are left to repeat in its `frames`.

    What arrives too `early` waits until all of them have been repeated.
    """

    def __init__(self, frames: RegionFrames) -> None:
        self.early: list[ParcelArrived | m.RegionRequest] = []
        self._frames = frames
        self._entries: Iterator[ParcelArrived] | None = None

    @property
    def has_begun(self) -> bool:
        """Whether the region has joined, so that its frames are repeated."""
        return self._entries is not None

    @own_members()
    def begin(self, frame: int) -> None:
        """Begin to repeat the frames up to the one that the world is in.

        Raises WorldStopped if they cannot be repeated.
        """
        frames = self._frames
        if frame > frames.region.frame and not frames.journal.exists:
            lost = f"its journal was longer than {MAX_BYTES >> 20} MiB"
            raise WorldStopped(f"a new process cannot repeat {frame} frames: {lost}")
        frames.parcels.repeats = True
        entries = frames.journal.read()
        first = next(entries, None)
        if first is not None and first.source == CHECKPOINT:
            self._restore(RegionCheckpoint.decoded(first.data))
        frames.start()
        self._entries = iter(()) if first is None else chain([first], entries)

    def repeat(self) -> bool:
        """Run the frames of the process before this one again; others have what it sent.

        Returns False if hosts have to answer first. Raises WorldStopped for invalid entries.
        """
        frames, entries = self._frames, self._entries
        assert entries is not None
        _exhaust(frames.advance())
        # One by one, because the report of a repeated frame has the entries up to it.
        while not frames.is_busy and (entry := next(entries, None)) is not None:
            if entry.source == COORDINATOR:
                self._note(entry.data)
            elif entry.source != CHECKPOINT:
                frames.accept(entry)
            _exhaust(frames.advance())
        if frames.is_busy:
            return False
        frames.parcels.repeats = False
        frames.journal.open()
        return True

    def _note(self, data: bytes) -> None:
        request = self._frames.decoder.to_member(data)
        assert isinstance(request, m.RegionRequest)
        self._frames.note(request)

    def _restore(self, checkpoint: RegionCheckpoint) -> None:
        """Continue from the state that a former process of this region has saved."""
        frames = self._frames
        frames.restore(checkpoint)
        kept, arrived, reports, requests, sent_bytes = checkpoint.messages
        decoder = Decoder(frames.file.world.vocabulary, ON_DISK)
        frames.parcels.sent_bytes = sent_bytes
        for target, data in kept:
            parcel = from_message(decoder.parcel(data), frames.region.number, target)
            frames.parcels.outbox.keep([KeptMessage.of(parcel, data)])
        for source, data in arrived:
            frames.accept(ParcelArrived(source, data))
        for data in reports:
            report = decoder.from_member(frames.name, data)
            assert isinstance(report, m.TickReply)
            frames.requests.reports[report.frame] = report
        for data in requests:
            self._note(data)


def _exhaust(reports: Iterable[m.TickReply]) -> None:
    """Run frames whose reports others have."""
    for _ in reports:
        pass
