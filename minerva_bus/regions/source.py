"""The frames of a region, with the places of its nodes and of the senders of its events."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.collection import visual_events
from minerva_bus.frame.live import LiveSource
from minerva_bus.frame.views import due_views
from minerva_bus.regions.halo import HaloViews
from minerva_bus.regions.merging import PlacedEvent
from minerva_bus.regions.norms import Judged
from minerva_bus.regions.place_table import Place
from minerva_bus.regions.places import SenderPlaces, after_frame
from minerva_bus.regions.views import NO_VIEWS, PartialViews

Judge: TypeAlias = Callable[[int, Sequence[PlacedEvent]], Judged]


class RegionSource(LiveSource):
    """The frames of a region; keeps the places of its nodes, and of the senders of its events.

    `own` are the members in its process; others may only be hosts of agents.
    `rejected` are the numbers of those `sent` that norms reject, and `halted` the agents whose
    actions devices must not execute. `views_only`: the world is over, so the frame makes views
    only, of all types that devices request.
    """

    has_all_agents = False
    # Without its only host, agents would not evolve, and the string would be that of no other run.
    awaits_leavers = True

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        super().__init__(algorithm)
        self.places: Sequence[Place] = ()
        self.sent: Sequence[PlacedEvent] = []
        self.rejected: tuple[int, ...] = ()
        self.halted: tuple[str, ...] = ()
        self.own = frozenset[str]()
        self.judge: Judge | None = None
        self.shown = NO_VIEWS
        self.views = PartialViews()
        self.halo: HaloViews | None = None
        self.views_only = False
        self.begin, self.collect, self.commit = self._begin, self._collect, self._commit

    @property
    def permitted(self) -> Sequence[PlacedEvent]:
        """The events for the next frame."""
        rejected = frozenset(self.rejected)
        return [each for n, each in enumerate(self.sent) if n not in rejected]

    def objection(self, hello: m.Hello) -> str:
        """Reason why a member, which is not in this process, cannot take part; or an empty string.

        The events of a generator would be those of this region alone, and so would a view.
        """
        serves = hello.ticks or hello.generates or hello.draws or hello.topics or hello.publishes
        if hello.member in self.own or (hello.kinds and not serves):
            return ""
        return "a region takes only hosts of agents; let it join the world, not the region"

    def why_over(self) -> str:
        """No reason: the region ends when all others do, which its algorithm does not know."""
        return ""

    def _begin(self) -> None:
        if not self.views_only:
            self.collection.begin()

    def _collect(self) -> None:
        if not self.views_only:
            self.collection.collect()
            return
        algorithm = self._algorithm
        due = due_views(algorithm.members.index, algorithm.frame, (), closing=True)
        algorithm.in_flight.events.visual = visual_events(algorithm, due)

    def evolve(self) -> None:
        """Steps 5 and 6; of the last views, step 6."""
        if self.views_only:
            self.evolution.request()
        else:
            super().evolve()

    def _commit(self) -> None:
        algorithm = self._algorithm
        composition, changed = algorithm.composition, algorithm.in_flight.result.changed
        self.halted = algorithm.in_flight.result.halted
        # Before the replacement: views are of the string that the frame began with, and agents
        # that died in this frame have no place after it.
        self.shown = self.views.part(algorithm.in_flight, composition, self.places)
        if self.halo is not None:
            self.halo.note(algorithm.in_flight, composition, self.places)
        sent = self.evolution.sent_in_order()
        senders = SenderPlaces(self.places, composition) if sent else None
        self.sent = [PlacedEvent(senders.of(event), event) for event in sent] if senders else []
        if changed:
            self.places = after_frame(self.places, composition, changed, algorithm.frame)
        self.evolution.commit()
        if self.judge is not None and not self.views_only:
            # In the string of the next frame, as with one coordinator, which has its number.
            self.sent, self.rejected = self.judge(algorithm.frame, self.sent)
