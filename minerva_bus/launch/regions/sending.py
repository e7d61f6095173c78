"""Sends parcels to other regions, and keeps and repeats them until they have arrived."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from minerva_bus.launch.regions.repeats import RegionRepeats
from minerva_bus.regions.attached import Replies
from minerva_bus.regions.messages import AgainMessage, to_message
from minerva_bus.regions.outbox import Outbox
from minerva_bus.regions.parcel import Parcel
from minerva_bus.wire.codec import encode


@dataclass(frozen=True, slots=True)
class KeptMessage:
    """A parcel, or replies of services, as bytes: they may be sent again, or be in a checkpoint."""

    frame: int
    target: int
    needed_in: int
    data: bytes

    @staticmethod
    def of(message: Parcel | Replies, data: bytes) -> KeptMessage:
        """A message that is encoded as `data`."""
        return KeptMessage(message.frame, message.target, message.needed_in, data)


class ParcelSender:
    """The parcels of a region. `send` sends bytes to a region; they may be lost.

    While it `repeats` the frames of a former process, nothing is sent: others have the parcels, or
    request them. `sent_bytes` counts the bytes of all parcels, also of those.
    """

    def __init__(self, send: Callable[[int, bytes], None]) -> None:
        self.outbox = Outbox[KeptMessage]()
        self.repeats = False
        self.sent_bytes: int = 0
        self._send = send
        self._repeats = RegionRepeats()

    def send(self, messages: Sequence[Parcel | Replies]) -> None:
        """Send parcels for the first time."""
        sent = [KeptMessage.of(message, encode(to_message(message))) for message in messages]
        self.outbox.keep(sent)
        for message in sent:
            self.sent_bytes += len(message.data)
            if not self.repeats:
                self._send(message.target, message.data)

    def again(self, regions: Iterable[int], since: int = -1) -> None:
        """Send what these regions may not have, of the frame `since` and of later ones."""
        for region in regions:
            for message in self.outbox.kept_for(region):
                if message.frame >= since:
                    self._send(region, message.data)

    def received(self, message: Parcel | Replies, *, is_new: bool, since: int) -> None:
        """Note a message of another region, which sends those `since` a frame if it is asked."""
        if not is_new and message.frame < since:
            self._repeats.note(message)

    def a_second_later(self, awaited: Iterable[int], frame: int) -> None:
        """Request what may have been lost; `awaited` are the regions needed for `frame`.

        Called once a second. Raises WorldStopped if a region sends nothing valid.
        """
        awaited = [*awaited]
        self._repeats.a_second_later(awaited, frame)
        for region in awaited:
            self._send(region, encode(AgainMessage(frame)))

    def frame_begun(self) -> None:
        """Note that everything needed for a frame has arrived."""
        self._repeats.clear()
