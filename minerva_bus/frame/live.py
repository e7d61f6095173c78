"""Sources of frames: they provide the events and results of a frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import CollectionStep
from minerva_bus.frame.evolution import EvolutionStep
from minerva_bus.frame.member_states import MemberEntry

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class FrameSource:
    """The steps of Table 2 whose inputs are from members or from a record.

    This base class is a source without members: it ignores their messages.
    """

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm

    # --- a frame ---

    def has_next(self) -> bool:
        """Whether a frame can begin."""
        return True

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

    # --- stimuli ---

    def tick_reply(self, reply: m.TickReply) -> None:
        """Accept the events of a member in step."""
        self._algorithm.members.get(reply.member).late += 1

    def evolve_reply(self, reply: m.EvolveReply) -> None:
        """Accept a host's results for its fragments."""
        self._algorithm.members.get(reply.member).late += 1

    def emitted(self, emitted: m.Emitted) -> None:
        """Accept events of a free-running generator."""

    def order(self, order: s.Publish) -> None:
        """Accept an event from a person."""

    def seek(self, frame: int) -> None:
        """Continue with another frame, if the source can."""

    def ask(self, member: MemberEntry) -> None:
        """Repeat the request to a member that has returned while the frame waits for it."""

    def ask_again(self, fragments: list[str]) -> None:
        """Request fragments once more: their host is gone, or one has returned."""

    def lighten(self, host: str) -> bool:
        """Repeat a frame that has ended a host twice by fewer events, if the source can."""
        return False

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
        self.evolve, self.lighten = evolution.request, evolution.lighten

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        algorithm = self._algorithm
        if algorithm.composition.empty:
            return "the string is empty"
        if finished := algorithm.goal.finished:
            return finished
        # Last, because an empty string or a reached goal is the more specific reason.
        if algorithm.world.frames and algorithm.frame >= algorithm.world.frames:
            return "the frames are over"
        return ""
