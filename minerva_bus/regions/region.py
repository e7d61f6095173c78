"""A region: the frame algorithm on a part of a world's string, between parcels of the others.

A region runs through `enter`, one frame of its algorithm, and `leave`, which returns the parcels
for the others. It needs their parcels of frame t before frame t+1 begins, or a later one, by its
`Schedule`. So it is a few frames ahead of other regions at most. It depends neither on clocks nor
on the transport of parcels, which may arrive in any order and more than once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.lag import saved_strays
from minerva_bus.frame.member import Member
from minerva_bus.grammar.scene import agents
from minerva_bus.regions.arriving import check_arriving
from minerva_bus.regions.attached import HOME, AttachedServices, Replies
from minerva_bus.regions.balancing import moved
from minerva_bus.regions.dividing import NOTHING, Border, cut
from minerva_bus.regions.halo import HaloViews
from minerva_bus.regions.halo_part import NO_HALO
from minerva_bus.regions.inbox import ParcelInbox
from minerva_bus.regions.kept import own_parts
from minerva_bus.regions.merging import PlacedEvent, Units, in_order, merged
from minerva_bus.regions.nearby import LEFT, NearbyServices
from minerva_bus.regions.norms import NO_NORMS, NO_REPORT, Judged, NormPart, NormReport, RegionNorms
from minerva_bus.regions.parcel import Parcel
from minerva_bus.regions.partition import Partition
from minerva_bus.regions.place_table import repeats
from minerva_bus.regions.postponing import PostponedEvents
from minerva_bus.regions.progress import Progress
from minerva_bus.regions.reach import check_reach
from minerva_bus.regions.routing import Routing
from minerva_bus.regions.schedule import Schedule
from minerva_bus.regions.source import RegionSource
from minerva_bus.regions.views import NO_VIEWS, PartialViews
from minerva_bus.world.norms import SOURCE


class Region:
    """One region of a world. `partition` applies to the frames that begin next."""

    def __init__(
        self,
        world: World,
        number: int,
        partition: Partition,
        members: Iterable[Member] = (),
        own: Units | None = None,
        received: NormPart | None = None,
        ahead: int = 0,
    ) -> None:
        """`world` is the whole world, whose string is cut here, equally in each region.

        Regions run `ahead` by so many frames: see `Schedule`.
        `members` are those of the world; the region delivers messages to them by
        `services.deliver`. A region that continues a run has its `own` part instead of a cut, and
        what norms have `received`; it has entered its first frame.
        """
        if own is None:
            own = cut(world.scene, partition, saved_strays(world.past.saved))[number]
        self.number = number
        self.partition = partition
        members = [*members]
        saved = world.past.saved
        nearby = NearbyServices(number, partition, members, world.shown, own, saved)
        self.services = AttachedServices(partition.count, nearby, members, world.shown)
        # The region itself delays events, as it alone knows which of them come from others.
        saved = saved if LEFT in saved else own_parts(saved, nearby.names, own, number)
        past = replace(world.past, saved=saved)
        part = replace(world, scene=own.scene, shown=(), lag=None, past=past)
        self.algorithm = FrameAlgorithm(part, RegionSource)
        assert isinstance(self.algorithm.source, RegionSource)
        self._source = self.algorithm.source
        self._source.places = own.places
        self._source.own = frozenset(member.name for member in members)
        self._postponed = PostponedEvents(world, own.scene)
        self.schedule = Schedule.of(world.lag, ahead)
        self._inbox = ParcelInbox(number, world.past.frame, self.schedule)
        self._source.views = PartialViews(self.services.drawn)
        self._halo = self._source.halo = HaloViews(number, nearby.halos) if nearby.names else None
        self._last = False
        self._cells = partition
        self._remaining: Units | None = None
        self.algorithm.goal.forget()
        self._border = Border(number)
        self._norms: RegionNorms | None = None
        self.for_all: Sequence[PlacedEvent] = ()
        if world.norms:
            algorithm = self.algorithm
            self._norms = algorithm.norms = RegionNorms(world, algorithm.composition, number)
            self._source.judge = self._judge
            self._norms.crossing = self._postponed.crossing
            if received is not None:
                self._norms.receive([received])
            elif world.past.frame:
                self._norms.judge_past(world, algorithm.inbox)
                algorithm.members.saved[SOURCE] = self._norms.saved()

    @property
    def frame(self) -> int:
        """Number of the next frame, or of the one in progress."""
        return self.algorithm.frame

    @property
    def units(self) -> Units:
        """The region's part of w, before agents that leave it have been removed."""
        return Units(self._source.places, self.algorithm.scene.pieces)

    @property
    def sent(self) -> Sequence[PlacedEvent]:
        """The events that the region's agents have sent in the last frame, before norms."""
        return self._source.sent

    @property
    def norm_report(self) -> NormReport:
        """What the coordinator has to know of norms after a frame, before `leave`."""
        if self._norms is None:
            return NO_REPORT
        source, sanctions = self._source, tuple(self.algorithm.inbox.sanctions)
        return NormReport(source.rejected, self._norms.counts, sanctions, source.halted)

    def _judge(self, frame: int, sent: Sequence[PlacedEvent]) -> Judged:
        assert self._norms is not None
        inbox = self.algorithm.inbox
        inbox.sanctions = [*self._norms.take_received(), *inbox.sanctions]
        return self._norms.judge(frame, sent)

    # --- before a frame ---

    def receive(self, parcel: Parcel | Replies) -> bool:
        """Accept a parcel, or replies of services; returns False if it has arrived before.

        Raises ProtocolError for one that its sender cannot have, because this region has not sent
        the parcels that it would need.
        """
        last = self.frame + self.schedule.ahead
        if parcel.frame > last:
            raise ProtocolError(f"it is of frame {parcel.frame}, expected at most {last}")
        if isinstance(parcel, Replies):
            return self.services.receive(parcel)
        return self._inbox.add(parcel)

    @property
    def arrived(self) -> list[Parcel | Replies]:
        """The parcels for frames that have not been entered, and replies for those not begun."""
        return [*self._inbox.kept, *self.services.arrived]

    def expect(self, sources: Mapping[int, Collection[int]]) -> None:
        """These regions have sent parcels after each of these frames: others have sent none.

        Raises ProtocolError for a region that does not exist.
        """
        named = {region for regions in sources.values() for region in regions}
        if not named.issubset(range(self.partition.count)):
            raise ProtocolError(f"parcels of regions {sorted(named)}: some do not exist")
        self._inbox.expect(sources)

    @property
    def missing(self) -> list[int]:
        """The regions that have not sent what `enter` needs, or then the next frame."""
        if self._has_entered:
            return self.services.lacks(self.frame, last=self._last)
        return self._inbox.missing(self.frame)

    def enter(
        self, for_all: Callable[[], Iterable[PlacedEvent]] = tuple, *, last: bool = False
    ) -> None:
        """Prepare the next frame, once, from the parcels: agents that arrive, and all events.

        `for_all` returns the events of the last frame that all regions need, from all of them.
        `last`: the world is over, so that services see views only, and `settle` follows. Raises
        ProtocolError for agents that do not belong here, or a parcel that is not expected.
        """
        self._last = last
        if self._has_entered:
            return
        arrived, inbox = self._inbox.enter(self.frame), self.algorithm.inbox
        parcels = arrived.present
        check_arriving(parcels, self.partition, self.algorithm.composition)
        self.services.take(self.frame - 1, parcels)
        self.services.nearby.answer(self.frame, last=last)
        self._join([parcel.units for parcel in parcels])
        self._postponed.enter(self.frame, self.algorithm.composition)
        self._postponed.queue(inbox, arrived.later)
        sent = chain(*(parcel.events for parcel in parcels), for_all())
        inbox.emitted = in_order(sent)
        if self._norms is not None:
            norms = [parcel.norms for parcel in parcels]
            self._norms.receive(norms)
            inbox.sanctions = [event for part in norms for event in part.sanctions]
            # Counts have changed since the last frame, by judging and by agents that have moved.
            self.algorithm.members.saved[SOURCE] = self._norms.saved()

    def give(self, request: m.RegionRequest, *, again: bool = False) -> None:
        """Begin a frame, perhaps `again`, with events from outside and perhaps with new borders.

        Raises ProtocolError for borders of other regions.
        """
        self._source.views.repeats = again
        self._source.views_only = request.views
        self.partition = moved(self.partition, request.borders)
        self.algorithm.inbox.replace(request.events)
        if self._norms is not None:
            self._norms.people = frozenset(request.people)

    def settle(self) -> None:
        """Let services know what others have saved of agents that arrive with the last frame."""
        self.services.nearby.settle(self.frame)

    def end(self) -> None:
        """End the world before the next frame."""
        if self._norms is not None:
            self._norms.forget_judged()

    @property
    def norms(self) -> Parcel:
        """What norms have received for the frame that begins, in a parcel to this region."""
        received = NO_NORMS if self._norms is None else self._norms.received()
        return Parcel(self.frame, self.number, self.number, NOTHING, (), norms=received)

    @property
    def homes(self) -> dict[str, dict[str, int]]:
        """Where agents are at home in the frame that begins, as saved data of a checkpoint."""
        return self._postponed.saved(self.frame, self.algorithm.composition)

    @property
    def _has_entered(self) -> bool:
        return self._inbox.entered > self.frame

    def _join(self, arriving: Sequence[Units]) -> None:
        remaining, self._remaining = self._remaining, None
        if remaining is None and not any(arriving):
            return
        units = merged([self.units if remaining is None else remaining, *arriving])
        if repeats(units.places):
            raise ProtocolError("two nodes have the same place")
        self.algorithm.composition.become(units.scene)
        self.algorithm.placement.outdated = True
        self._source.places = units.places

    # --- after a frame ---

    def leave(self) -> list[Parcel]:
        """The parcels after a frame: one for itself, and the non-empty ones for others.

        Afterwards `for_all` are the events that all regions need. What `progress` has returned is
        forgotten.
        """
        frame, composition = self.frame - 1, self.algorithm.composition
        check_reach(self.partition, composition)
        self.algorithm.goal.forget()
        leaving, self._remaining = dict[int, Units](), None
        if self.schedule.moves(self.frame):
            leaving, self._remaining = self._border.leaving(self.units, self.partition)
        moving = {
            agent.id: region for region, units in leaving.items() for agent in agents(units.scene)
        }
        routing = Routing(self.number, self.partition, composition, moving)
        near, crossing = self._postponed.divided(self._source.permitted)
        late = routing.route(crossing, late=True)
        waits = self.schedule.waits(self.frame)
        self.for_all, near = routing.for_all(near) if waits else ((), near)
        routed = self._routed(routing, near)
        self.services.nearby.moved(moving)
        views = {HOME: self._source.shown} if self._source.shown else {}
        kept = self.services.nearby.kept
        shown = {} if self._halo is None else self._halo.by_region(self._cells, kept)
        self._cells = self.partition
        norms = self._norm_parts(routing, moving)
        targets = {self.number, *leaving, *routed, *late, *views, *shown, *norms}
        parcels = [
            Parcel(
                frame,
                self.number,
                to,
                leaving.get(to, NOTHING),
                tuple(routed.get(to, ())),
                views.get(to, NO_VIEWS),
                norms.get(to, NO_NORMS),
                tuple(late.get(to, ())),
                shown.get(to, NO_HALO),
            )
            for to in sorted(targets)
        ]
        return [parcel for parcel in parcels if parcel or parcel.target == self.number]

    def _routed(
        self, routing: Routing, near: Iterable[PlacedEvent]
    ) -> Mapping[int, Sequence[PlacedEvent]]:
        """The events for the next frame, by region; if it waits for no other one, all stay here."""
        return routing.route(near) if self.schedule.waits(self.frame) else routing.keep(near)

    def _norm_parts(self, routing: Routing, moving: Mapping[str, int]) -> dict[int, NormPart]:
        if self._norms is None:
            return {}
        inbox, norms = self.algorithm.inbox, self._norms
        sanctions = self._routed(routing, [PlacedEvent((), event) for event in inbox.sanctions])
        judged = [PlacedEvent((), event) for event in norms.take_later()]
        later = self._routed(routing, judged)
        inbox.sanctions = []  # They may follow their agents to other regions.
        return norms.parts(range(self.partition.count), moving, sanctions, later)

    def keeps(self, parcel: Parcel) -> bool:
        """Whether a parcel is for this region, which has received it then."""
        return parcel.target == self.number and self.receive(parcel)

    def progress(self) -> Progress:
        """What the last frame means for the end of the world."""
        algorithm, goal = self.algorithm, self.algorithm.goal
        resting = algorithm.at_rest and not self._inbox.has_own_events
        return Progress(resting, goal.reached, goal.given_up, goal.striving)
