"""The last views of a world in regions, as those that one coordinator shows when the world is over.

Regions make them in a frame in which no agent evolves. Their services see them as those of any
frame: from the parcels that the request of the next one lists, which does not begin any more.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.phases import Phase
from minerva_bus.regions.requesting import FrameRequests

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class LastViews:
    """Requests the last views of the regions `names`, by number, and notes who has made them.

    If regions run ahead of each other, no service in them sees views.
    """

    def __init__(
        self, algorithm: FrameAlgorithm, requests: FrameRequests, names: Mapping[str, int]
    ) -> None:
        self._algorithm = algorithm
        self._requests = requests
        self._names = names
        self._request: m.RegionRequest | None = None
        self._targets: dict[int, Sequence[int]] = {}

    @property
    def _outstanding(self) -> dict[tuple[str, int], tuple[str, ...]]:
        return self._algorithm.in_flight.requests.outstanding

    def request(self) -> None:
        """Request the views of all regions, now that the world is over."""
        if self._algorithm.phase is not Phase.CLOSING or self._requests.runs_ahead:
            return
        self._request = self._requests.views_of(self._algorithm.frame)
        self._outstanding.update({(name, 0): (name,) for name in self._names})
        self._algorithm.out.send(s.TICKED, self._request)

    def again(self, regions: Iterable[str]) -> None:
        """Continue to wait for regions whose processes are gone, if others replace them."""
        members = self._algorithm.members
        names = [name for name in regions if name in self._names and members.get(name).expected]
        self._outstanding.update({(name, 0): (name,) for name in names})

    def returned(self, region: str) -> None:
        """Repeat the request to a region that has returned without having answered."""
        if self._request is not None and (region, 0) in self._outstanding:
            self._algorithm.out.send(region, self._request)

    def awaits(self, reply: m.TickReply) -> bool:
        """Whether a report is that of the last views of its region."""
        request, outstanding = self._request, self._outstanding
        is_last = request is not None and reply.frame == request.frame
        return is_last and (reply.member, 0) in outstanding

    def accept(self, region: str, targets: Sequence[int]) -> None:
        """Note to which regions one has sent its views."""
        self._targets[self._names[region]] = targets
        del self._outstanding[region, 0]

    def stop(self, phase: Phase) -> None:
        """Tell the regions in `phase`, before their world stops, which parcels have views."""
        frame, names = self._algorithm.frame, self._names
        if self._requests.runs_ahead:
            return
        if phase is Phase.CLOSING and self._targets.keys() >= {*names.values()}:
            self._requests.note_parcels(frame, _by_number(self._targets))
            self._algorithm.out.send(s.TICKED, self._requests.last(frame + 1))
        elif phase is Phase.READY:
            # An order ends it between two frames: the views of the last one are those to see.
            self._algorithm.out.send(s.TICKED, self._requests.last(frame))


def _by_number(targets: Mapping[int, Sequence[int]]) -> Collection[Sequence[int]]:
    return [each for _, each in sorted(targets.items())]
