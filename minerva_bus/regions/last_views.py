"""The last views of a world in regions, as those that one coordinator shows when the world is over.

Regions make them in a frame in which no agent evolves. Their services see them as those of any
frame: from the parcels that the request of the next one lists, which does not begin any more. The
coordinator waits for both, and no region ends before: one that has ended sends no parcel again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.phases import Phase
from minerva_bus.regions.requesting import FrameRequests

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class LastViews:
    """Requests the last views of the regions `names`, by number, and that services see them.

    `targets` returns the regions to which a report's sender has sent parcels, or raises
    ProtocolError. If regions run ahead of each other, no service in them sees views.
    """

    def __init__(
        self,
        algorithm: FrameAlgorithm,
        requests: FrameRequests,
        names: Mapping[str, int],
        targets: Callable[[m.TickReply], Sequence[int]],
    ) -> None:
        self._algorithm = algorithm
        self._requests = requests
        self._names = names
        self._targets_of = targets
        self._targets: dict[int, Sequence[int]] = {}
        self._requested: list[m.RegionRequest] = []

    @property
    def _outstanding(self) -> dict[tuple[str, int], tuple[str, ...]]:
        """Keys are the name of a region and the frame that it has not reported."""
        return self._algorithm.in_flight.requests.outstanding

    def request(self) -> None:
        """Request the views of all regions, now that the world is over."""
        if self._algorithm.phase is Phase.CLOSING and not self._requests.runs_ahead:
            self._request(self._requests.views_of(self._algorithm.frame))

    def _request(self, request: m.RegionRequest) -> None:
        self._requested.append(request)
        self.again(self._names)
        self._algorithm.out.send(s.TICKED, request)

    def again(self, regions: Iterable[str]) -> None:
        """Wait for regions, and for those whose processes are gone, if others replace them.

        A new process of a region that has reported has to show its services the views again.
        """
        awaited, members = {*regions}, self._algorithm.members
        for name in self._names if self._requested else ():
            member = members.get(name)
            if member.expected and (name in awaited or not member.active):
                self._outstanding[name, self._requested[-1].frame] = (name,)

    def returned(self, region: str) -> None:
        """Repeat the requests to a region that has returned."""
        for request in self._requested if region in self._names else ():
            self._algorithm.out.send(region, request)

    def awaits(self, reply: m.TickReply) -> bool:
        """Whether a report is that of the last views of its region, or that services see them."""
        return bool(self._requested) and (reply.member, reply.frame) in self._outstanding

    def accept(self, reply: m.TickReply) -> None:
        """Note the report of a region. Raises ProtocolError for one without its part."""
        views = self._requested[0]
        if reply.frame == views.frame:
            self._targets[self._names[reply.member]] = self._targets_of(reply)
        del self._outstanding[reply.member, reply.frame]
        is_complete = not self._outstanding and self._targets.keys() >= {*self._names.values()}
        if reply.frame == views.frame and is_complete:
            targets = [each for _, each in sorted(self._targets.items())]
            self._requests.note_parcels(views.frame, targets)
            self._request(self._requests.last(views.frame + 1, views=True))

    def stop(self, phase: Phase) -> None:
        """If an order ends the world between two frames, let services see the last one's views."""
        if phase is Phase.READY and not self._requests.runs_ahead:
            self._algorithm.out.send(s.TICKED, self._requests.last(self._algorithm.frame))
