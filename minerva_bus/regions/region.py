"""A region: the frame algorithm on a part of a world's string, between parcels of the others.

A region runs through `enter`, one frame of its algorithm, and `leave`, which returns the parcels
for the others. It needs their parcels of frame t before frame t+1 begins, and may therefore be at
most one frame ahead of another region. It depends neither on clocks nor on the transport of
parcels, which may arrive in any order and more than once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from minerva_bus.errors import ProtocolError
from minerva_bus.frame import messages as m
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.description import World
from minerva_bus.frame.live import why_over
from minerva_bus.frame.member import Member
from minerva_bus.grammar.scene import Piece, agents
from minerva_bus.regions.arriving import check_arriving
from minerva_bus.regions.attached import HOME, AttachedServices, Replies
from minerva_bus.regions.balancing import moved
from minerva_bus.regions.dividing import NOTHING, cut, divided
from minerva_bus.regions.inbox import ParcelInbox
from minerva_bus.regions.merging import PlacedEvent, Units, in_order, merged
from minerva_bus.regions.norms import NO_NORMS, NormPart, RegionNorms
from minerva_bus.regions.parcel import Parcel, Progress
from minerva_bus.regions.partition import Partition, regions_of
from minerva_bus.regions.reach import check_reach
from minerva_bus.regions.routing import Routing
from minerva_bus.regions.source import RegionSource
from minerva_bus.regions.views import NO_VIEWS
from minerva_bus.world.norms import SOURCE


class Region:
    """One region of a world. `partition` applies to the frames that begin next.

    `over` is the reason why no further frame begins, known after `enter`, and `reached` whether the
    world has ended by its goal. `resting`: the next frame would change nothing in any region.
    """

    def __init__(
        self,
        world: World,
        number: int,
        partition: Partition,
        members: Iterable[Member] = (),
        own: Units | None = None,
        received: NormPart | None = None,
    ) -> None:
        """`world` is the whole world, whose string is cut here, equally in each region.

        `members` are those of the world; the region delivers messages to them by
        `services.deliver`. A region that continues a run has its `own` part instead of a cut, and
        what norms have `received`; it has entered its first frame.
        """
        own = cut(world.scene, partition)[number] if own is None else own
        self.number = number
        self.partition = partition
        self.over = ""
        self.reached = False
        self.resting = False
        self.services = AttachedServices(number, partition.count, members)
        self.algorithm = FrameAlgorithm(replace(world, scene=own.scene), RegionSource)
        assert isinstance(self.algorithm.source, RegionSource)
        self._source = self.algorithm.source
        self._source.places = own.places
        self._world = world
        self._inbox = ParcelInbox(world.past.frame + 1)
        self._remaining: Units | None = None
        self._note_known()
        self._settled: dict[int, Piece] = {}
        self._settled_by = partition
        self._norms: RegionNorms | None = None
        if world.norms:
            algorithm = self.algorithm
            self._norms = algorithm.norms = RegionNorms(world, algorithm.composition, number)
            self._source.judge = self._norms.judge
            if received is not None:
                self._norms.receive([received])

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
        """The events that the region's agents have sent in the last frame."""
        return self._source.sent

    # --- before a frame ---

    def receive(self, parcel: Parcel | Replies) -> bool:
        """Accept a parcel, or replies of services; returns False if it has arrived before.

        Raises ProtocolError for one that its sender cannot have, because this region has not sent
        the parcels that it would need.
        """
        if parcel.frame > self.frame:
            raise ProtocolError(f"it is of frame {parcel.frame}, expected at most {self.frame}")
        if isinstance(parcel, Replies):
            return self.services.receive(parcel)
        return self._inbox.add(parcel)

    @property
    def arrived(self) -> list[Parcel | Replies]:
        """The parcels for frames that have not been entered, and replies for those not begun."""
        return [*self._inbox.kept, *self.services.arrived]

    @property
    def missing(self) -> list[int]:
        """The regions that have not sent what `enter` needs, or then the next frame."""
        if self._has_entered:
            return [HOME] if self.services.lacks(self.frame) else []
        arrived = self._inbox.sources(self.frame - 1)
        return [region for region in range(self.partition.count) if region not in arrived]

    def enter(self) -> None:
        """Prepare the next frame, once, from the parcels: agents that arrive, and all events.

        The world is over if `over` is set afterwards. Raises ProtocolError if a region has sent
        agents that do not belong here.
        """
        if self._has_entered:
            return
        parcels = self._inbox.enter(self.frame)
        check_arriving(parcels, self.partition, self.algorithm.composition)
        self.services.take(self.frame - 1, {parcel.source: parcel.views for parcel in parcels})
        self._join([parcel.units for parcel in parcels])
        events = in_order(event for parcel in parcels for event in parcel.events)
        self.algorithm.inbox.emitted = events
        self._note_progress([parcel.progress for parcel in parcels])
        if self._norms is not None:
            norms = [parcel.norms for parcel in parcels]
            self._norms.receive(norms)
            self.algorithm.inbox.sanctions = [event for part in norms for event in part.sanctions]
            if self.over:
                self._norms.forget_judged()
            # Counts have changed since the last frame, by judging and by agents that have moved.
            self.algorithm.members.saved[SOURCE] = self._norms.saved()

    def give(self, outside: m.RegionInputs) -> None:
        """Begin a frame with events from outside of all regions, and perhaps with new borders.

        Raises ProtocolError for borders of other regions.
        """
        self.partition = moved(self.partition, outside.borders)
        self.algorithm.inbox.replace(outside.events)
        if self._norms is not None:
            self._norms.people = frozenset(outside.people)

    @property
    def norms(self) -> Parcel:
        """What norms have received for the frame that begins, in a parcel to this region."""
        received = NO_NORMS if self._norms is None else self._norms.received()
        own = self.number
        return Parcel(self.frame, own, own, NOTHING, (), self.progress(), norms=received)

    @property
    def _has_entered(self) -> bool:
        return self._inbox.entered > self.frame

    def _join(self, arriving: Sequence[Units]) -> None:
        remaining, self._remaining = self._remaining, None
        if remaining is None and not any(arriving):
            return
        units = merged([self.units if remaining is None else remaining, *arriving])
        if any(place == following for place, following in pairwise(units.places)):
            raise ProtocolError("two nodes have the same place")
        self.algorithm.composition.become(units.scene)
        self.algorithm.placement.outdated = True
        self._source.places = units.places

    def _note_progress(self, progress: Sequence[Progress]) -> None:
        goal, until = self.algorithm.goal, self._world.until
        for each in progress:
            goal.learn(each.reached, each.striving, each.given_up)
        left = sum(each.left.get(kind, 0) for each in progress for kind in goal.striving)
        ends = bool(until and (goal.reached or goal.given_up)) and not left
        self.reached = ends and not goal.given_up
        self._note_known()
        self.resting = all(each.resting for each in progress)
        empty = all(each.empty for each in progress)
        finished = goal.reason() if ends else ""
        self.over = why_over(self._world, self.frame, empty, finished)

    def _note_known(self) -> None:
        """Note what all regions know of the goal, before a frame."""
        goal = self.algorithm.goal
        self._known = goal.reached, goal.striving, goal.given_up

    # --- after a frame ---

    def leave(self) -> list[Parcel]:
        """The parcels after a frame, one for each region, itself included."""
        frame, composition = self.frame - 1, self.algorithm.composition
        check_reach(self.partition, composition)
        leaving = self._leaving()
        moving = {
            agent.id: region for region, units in leaving.items() for agent in agents(units.scene)
        }
        routing = Routing(self.number, self.partition, composition, moving)
        routed = routing.route(self._source.sent)
        progress = self.progress()
        views = {HOME: self._source.shown} if self.services.shows else {}
        norms = self._norm_parts(routing, moving)
        return [
            Parcel(
                frame,
                self.number,
                to,
                leaving.get(to, NOTHING),
                tuple(events),
                progress,
                views.get(to, NO_VIEWS),
                norms.get(to, NO_NORMS),
            )
            for to, events in enumerate(routed)
        ]

    def _norm_parts(self, routing: Routing, moving: Mapping[str, int]) -> dict[int, NormPart]:
        if self._norms is None:
            return {}
        inbox, regions = self.algorithm.inbox, range(self.partition.count)
        states = self._norms.states()
        sanctions = routing.route(PlacedEvent((), event) for event in inbox.sanctions)
        later = routing.route(PlacedEvent((), event) for event in self._norms.take_later())
        inbox.sanctions = []  # They may follow their agents to other regions.
        return {
            to: NormPart(
                states,
                self._norms.counts_of([who for who, region in moving.items() if region == to]),
                tuple([each.event for each in sanctions[to]]),
                tuple([each.event for each in later[to]]),
            )
            for to in regions
        }

    def progress(self) -> Progress:
        """The data of the last frame that other regions need."""
        algorithm, goal = self.algorithm, self.algorithm.goal
        reached, striving, given_up = self._known
        since = {who: why for who, why in goal.given_up.items() if given_up.get(who) != why}
        return Progress(
            algorithm.composition.empty,
            algorithm.at_rest,
            goal.reached - reached,
            goal.striving - striving,
            {**dict.fromkeys(given_up.keys() - goal.given_up.keys(), ""), **since},
            goal.left(),
        )

    def _leaving(self) -> dict[int, Units]:
        """The units whose agents are now in other regions, by region; the others remain."""
        if self._settled_by is not self.partition:
            self._settled, self._settled_by = {}, self.partition
        regions: list[NDArray[np.intp]] = []
        for piece in self.algorithm.scene.pieces:
            own = np.full(piece.count, self.number, np.intp)
            regions.append(own if id(piece) in self._settled else self._regions_of(piece, own))
        if all((each == self.number).all() for each in regions):
            # Pieces are kept, not only their ids: Python reuses the id of an object that is gone.
            self._settled = {id(piece): piece for piece in self.algorithm.scene.pieces}
            return {}
        parts = divided(self.units, regions)
        self._remaining = parts.pop(self.number, NOTHING)
        return parts

    def _regions_of(self, piece: Piece, own: NDArray[np.intp]) -> NDArray[np.intp]:
        regions = regions_of(self.partition, piece)
        return own if regions is None else regions
