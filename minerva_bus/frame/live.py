"""Sources of frames: they provide the events and results of a frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import CollectionStep
from minerva_bus.frame.description import World
from minerva_bus.frame.event_sources import is_handed_over, is_people
from minerva_bus.frame.evolution import EvolutionStep
from minerva_bus.frame.member_states import MemberEntry
from minerva_bus.frame.own_agents import OwnAgents
from minerva_bus.frame.phases import Phase
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.scene import Piece

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class FrameSource:
    """The steps of Table 2 whose inputs are from members or from a record.

    This base class is a source without members: it ignores their messages. `admits_at_once`: a
    member that joins during a frame does not wait for the next one. `has_all_agents`: its string is
    that of the world, and not a part. `awaits_leavers`: an expected member that leaves is awaited
    like one that has vanished.
    """

    admits_at_once: bool = False
    has_all_agents: bool = True
    awaits_leavers: bool = False

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm

    # --- a frame ---

    def has_next(self) -> bool:
        """Whether a frame can begin."""
        return True

    @property
    def at_rest(self) -> bool:
        """Whether no member in step could change anything in the next frame."""
        members = self._algorithm.members
        return members.index.tickers <= members.resting

    def begin(self) -> None:
        """Request the events of the frame that begins."""

    def collect(self) -> None:
        """Steps 2 to 4: the events of the frame."""

    def evolve(self) -> None:
        """Steps 5 and 6: request the next string and the views."""

    def settle(self) -> bool:
        """Whether the results are final, with norms applied; otherwise more are requested."""
        return True

    def commit(self) -> None:
        """Step 8: w = w_next and t = t + 1."""

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        return ""

    def announce(self) -> None:
        """Step 10: announce that the next frame may begin."""
        self._algorithm.out.add(s.Ready(self._algorithm.frame))

    def stop(self, phase: Phase) -> None:
        """Prepare the members for the end of the world, which was in `phase`."""

    def early_replies(self, member: str) -> int:
        """The replies of a member that are outstanding for frames that have not begun."""
        return 0

    # --- stimuli ---

    def tick_reply(self, reply: m.TickReply) -> None:
        """Accept the events of a lockstep member."""
        self._algorithm.members.get(reply.member).late += 1

    def evolve_reply(self, reply: m.EvolveReply) -> None:
        """Accept a host's results for its fragments."""
        self._algorithm.members.get(reply.member).late += 1

    def agents_of(self, member: str) -> OwnAgents:
        """The agents about which a member answers: those of a host."""
        return OwnAgents(partial(self._hosted_by, member))

    def _hosted_by(self, member: str) -> list[Piece]:
        composition, placement = self._algorithm.composition, self._algorithm.placement
        fragments = composition.fragments
        return [fragments[name] for name in placement.fragments_of(member) if name in fragments]

    def objection(self, hello: m.Hello) -> str:
        """Reason why a member cannot take part in these frames, or an empty string."""
        return ""

    def emitted(self, emitted: m.Emitted) -> None:
        """Accept events of a free-running generator."""

    def order(self, order: s.Publish) -> None:
        """Accept an event from a person."""

    def ordered(self) -> Mapping[str, Sequence[AnyEvent]]:
        """Events outside of all complete frames, by source, if people have sent any of them."""
        algorithm = self._algorithm
        events = algorithm.in_flight.events
        # `collect` has moved the events of the frame out of the inbox, but they only count when the
        # frame is complete: until then a successor needs them from here.
        taken: dict[str, Sequence[AnyEvent]] = {}
        if algorithm.phase is Phase.EVOLVE:
            taken |= events.taken
        for source, orders in events.orders.items() if algorithm.in_frame else ():
            taken[source] = [*orders, *taken.get(source, ())]
        # The same events as `events.orders`, which have been added as people's.
        taken = {name: each for name, each in taken.items() if not is_handed_over(name)}
        waiting = algorithm.inbox.events
        if not any(map(is_people, (*taken, *waiting))):
            return {}
        sources = sorted({*taken, *waiting})
        return {name: [*taken.get(name, ()), *waiting.get(name, ())] for name in sources}

    def wait_with(self, events: Mapping[str, Sequence[AnyEvent]]) -> None:
        """Queue the events that a predecessor has noted as `ordered`."""
        self._algorithm.inbox.replace(events)

    def journaled(self) -> Mapping[str, Mapping[str, Any]]:
        """Plain data beside a checkpoint that only a successor of this coordinator needs."""
        return {}

    def saved_for(self, member: str) -> Mapping[str, Any] | None:
        """What a predecessor of a member that joins has saved last."""
        return self._algorithm.members.saved.get(member)

    def seek(self, frame: int) -> None:
        """Continue with another frame, if the source can."""

    def ask(self, member: MemberEntry) -> None:
        """Repeat the request to a member that has returned while the frame waits for it."""

    def ask_again(self, fragments: list[str]) -> None:
        """Request fragments once more: their host is gone, or one has returned."""

    def members_changed(self, hello: m.Hello | None) -> None:
        """Process a change: a member has joined with this hello, or, for None, has left."""


class LiveSource(FrameSource):
    """Frames with events from generators and results from hosts."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        super().__init__(algorithm)
        self.collection = collection = CollectionStep(algorithm)
        self.evolution = evolution = EvolutionStep(algorithm)
        # Bound methods save a call per step and message in each frame.
        self.begin, self.collect = collection.begin, collection.collect
        self.tick_reply, self.emitted = collection.tick_reply, collection.emitted
        self.order, self.ask = collection.order, collection.ask
        self.settle, self.commit = evolution.settle, evolution.commit
        self.evolve_reply, self.ask_again = evolution.reply, evolution.ask_again
        self.evolve = evolution.request

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        algorithm = self._algorithm
        composition, goal = algorithm.composition, algorithm.goal
        return why_over(algorithm.world, algorithm.frame, composition.empty, goal.finished)


def why_over(world: World, frame: int, empty: bool, finished: str) -> str:
    """Step 9: reason why this frame does not begin, or an empty string.

    `empty` is whether w is ε, and `finished` the reason of an end by the world's goal.
    """
    if empty:
        return "the string is empty"
    if finished:
        return finished
    # Last, because an empty string or a reached goal is the more specific reason.
    if world.frames and frame >= world.frames:
        return "the frames are over"
    return ""
