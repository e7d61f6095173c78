"""What a coordinator requests of its regions: frames, some of them before they are due."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.phases import Phase
from minerva_bus.regions.balancing import balanced, is_due, packed_borders
from minerva_bus.regions.messages import packed_pairs
from minerva_bus.regions.outside import OutsideEvents
from minerva_bus.regions.partition import Partition
from minerva_bus.regions.schedule import Schedule

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm

PARCELS: Final = "~parcels"
"""Key in the saved data of a journal for the pairs of regions with parcels; no member can have this
name."""


class FrameRequests:
    """The requests that regions may still have to answer, and reports of frames that are not due.

    A frame is requested ahead only without `outside` events, so those of the frame in progress are
    all that regions may have and the journal does not.
    """

    def __init__(
        self,
        algorithm: FrameAlgorithm,
        schedule: Schedule,
        partition: Partition | None,
        saved: Mapping[str, bytes] | None,
    ) -> None:
        """`saved` is what the property has returned to the predecessor of a successor."""
        self._algorithm = algorithm
        self._schedule = schedule
        self._partition = partition
        self._requests: dict[int, m.RegionRequest] = {}
        self._last: int = algorithm.frame - 1
        self._pairs = {int(frame): pairs for frame, pairs in (saved or {}).items()}
        self._early: dict[int, dict[str, m.TickReply]] = {}
        succeeds, ahead = saved is not None, schedule.ahead
        self.outside = OutsideEvents(algorithm.inbox, succeeds=succeeds, ahead=ahead)

    def begin(self, for_all: tuple[bytes, ...] = ()) -> Iterable[m.TickReply]:
        """Request the frame that begins, and those that may run ahead of it.

        `for_all` is what regions have reported for all of them, for the frame that begins.
        Returns the reports that have already arrived for it.
        """
        algorithm, first = self._algorithm, max(self._last + 1, self._algorithm.frame)
        for frame in range(first, self._schedule.last(algorithm.frame) + 1):
            if frame == algorithm.frame:
                if self.outside.take(frame):
                    algorithm.out.add(s.Fixed(frame))
            elif self.outside.wait_for(frame) or 0 < algorithm.world.frames <= frame:
                break
            self._requests[frame], self._last = self._request(frame, for_all), frame
            algorithm.out.send(s.TICKED, self._requests[frame])
        return self._early.pop(algorithm.frame, {}).values()

    def done(self, targets: Iterable[Sequence[int]]) -> None:
        """Note the regions to which each one has sent parcels in the frame that is complete now."""
        frame = self._algorithm.frame
        self._requests.pop(frame, None)
        self._last = max(self._last, frame)
        self.outside.current = {}
        self.note_parcels(frame, targets)
        needed = self._schedule.needs(frame)
        self._pairs = {past: pairs for past, pairs in self._pairs.items() if past >= needed}

    def note_parcels(self, frame: int, targets: Iterable[Sequence[int]]) -> None:
        """Note the regions to which each one has sent parcels in a frame."""
        self._pairs[frame] = packed_pairs(targets)

    @property
    def runs_ahead(self) -> bool:
        """Whether frames may be requested before they are due."""
        return self._schedule.ahead > 0

    def views_of(self, frame: int) -> m.RegionRequest:
        """The request of a frame that only makes views, because the world is over."""
        return m.RegionRequest(frame, self._parcels_for(frame), views=True)

    def last(self, frame: int, *, views: bool = False) -> m.RegionRequest:
        """The request of a frame that does not begin, because the world ends before it.

        `views`: the frame before it has made the last views, and regions report that services have
        seen them.
        """
        return m.RegionRequest(frame, self._parcels_for(frame), views=views, last=True)

    def __iter__(self) -> Iterator[m.RegionRequest]:
        return iter(self._requests.values())

    def is_early(self, frame: int) -> bool:
        """Whether a frame has been requested, but has not begun."""
        begun = self._algorithm.frame + (self._algorithm.phase is not Phase.READY)
        return frame >= begun and frame in self._requests

    def outstanding(self, member: str) -> int:
        """The frames that have been requested, but not begun, without the report of a region."""
        early = filter(self.is_early, self._requests)
        return sum(member not in self._early.get(frame, {}) for frame in early)

    @property
    def people(self) -> tuple[str, ...]:
        """The generators in this frame whose events count as sent by people."""
        return self._algorithm.members.standing_for_people(self.outside.current)

    @property
    def at_rest(self) -> bool:
        """Whether no event is on its way to a region."""
        return not (self.outside or any(self._pairs.values()))

    @property
    def saved(self) -> Mapping[str, bytes]:
        """What a successor continues with."""
        return {str(frame): pairs for frame, pairs in self._pairs.items()}

    # --- reports ---

    def keep(self, report: m.TickReply) -> None:
        """Keep the report of a frame that has not begun."""
        self._early.setdefault(report.frame, {})[report.member] = report

    def forget(self, member: str) -> None:
        """Forget the early reports of a region, whose new process sends them again."""
        for reports in self._early.values():
            reports.pop(member, None)

    def _request(self, frame: int, for_all: tuple[bytes, ...]) -> m.RegionRequest:
        """A function of complete frames and of fixed events, so a successor repeats it equally."""
        algorithm, parcels = self._algorithm, self._parcels_for(frame)
        if frame > algorithm.frame:
            return m.RegionRequest(frame, parcels)
        events = {name: tuple(sent) for name, sent in sorted(self.outside.current.items())}
        borders, for_all = self._borders(frame), for_all if any(for_all) else ()
        return m.RegionRequest(frame, parcels, events, self.people, borders, for_all)

    def _parcels_for(self, frame: int) -> tuple[bytes, ...]:
        return tuple(self._pairs.get(past, b"") for past in self._schedule.new(frame))

    def _borders(self, frame: int) -> bytes:
        """The borders that begin with a frame, if they move: a function of the string."""
        if not is_due(self._partition, frame):
            return b""
        return packed_borders(balanced(self._partition, self._algorithm.scene))
