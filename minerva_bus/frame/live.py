"""Sources of frames: where the events and results of a frame come from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import CollectionStep
from minerva_bus.frame.evolution import EvolutionStep
from minerva_bus.frame.members import MemberEntry

if TYPE_CHECKING:
    from minerva_bus.frame.algorithm import FrameAlgorithm


class FrameSource(Protocol):
    """Carries out the steps of Table 2 whose inputs come from members or from a record."""

    def has_next(self) -> bool:
        """Whether a frame can begin."""
        ...

    def begin(self) -> None:
        """Request the events of the frame that begins."""

    def collect(self) -> None:
        """Steps 2 to 4: the events of the frame."""

    def evolve(self) -> None:
        """Steps 5 and 6: request the next string and the views."""

    def settle(self) -> bool:
        """Whether the results are final, with norms applied; otherwise more are requested."""
        ...

    def commit(self) -> None:
        """Step 8: w = w_next and t = t + 1."""

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        ...

    def announce(self) -> None:
        """Step 10: announce that the next frame may begin."""

    def receive(self, stimulus: s.Stimulus) -> None:
        """Accept an answer of a member, or an event."""

    def ask(self, member: MemberEntry) -> None:
        """Ask a member that has returned while the frame waits for it."""

    def ask_again(self, fragments: list[str]) -> None:
        """Ask for fragments once more: their host is gone, or one has returned."""

    def seek(self, frame: int) -> None:
        """Continue with another frame, if the source can."""

    def members_changed(self, hello: m.Hello | None) -> None:
        """A member has joined with this hello, or None: one has left."""


class LiveSource:
    """Frames whose events come from generators, and whose results come from hosts."""

    def __init__(self, algorithm: FrameAlgorithm) -> None:
        self._algorithm = algorithm
        self.collection = CollectionStep(algorithm)
        self.evolution = EvolutionStep(algorithm)

    def has_next(self) -> bool:
        """Whether a frame can begin: always, because `why_over` decides before."""
        return True

    def begin(self) -> None:
        """Request the events of the frame that begins."""
        self.collection.begin()

    def collect(self) -> None:
        """Steps 2 to 4."""
        self.collection.collect()

    def evolve(self) -> None:
        """Steps 5 and 6."""
        self.evolution.request()

    def settle(self) -> bool:
        """Whether the results are final, with norms applied."""
        if not self.evolution.settle():
            return False
        self.evolution.enforce()
        return True

    def commit(self) -> None:
        """Step 8."""
        self.evolution.commit()

    def why_over(self) -> str:
        """Step 9: reason why no frame follows, or an empty string."""
        algorithm = self._algorithm
        if algorithm.composition.empty:
            return "the string is empty"
        if algorithm.goal.finished:
            return algorithm.goal.finished
        if algorithm.world.frames and algorithm.frame >= algorithm.world.frames:
            return "the frames are over"
        return ""

    def announce(self) -> None:
        """Step 10: announce that the next frame may begin."""
        self._algorithm.out.add(s.Ready(self._algorithm.frame))

    def receive(self, stimulus: s.Stimulus) -> None:
        """Accept an answer of a member, or an event."""
        match stimulus:
            case m.TickReply():
                self.collection.tick_reply(stimulus)
            case m.EvolveReply():
                self.evolution.reply(stimulus)
            case m.Emitted():
                self.collection.emitted(stimulus)
            case s.Order():
                self.collection.order(stimulus)
            case _:
                raise TypeError(f"no answer and no event: {stimulus!r:.100}")

    def ask(self, member: MemberEntry) -> None:
        """Ask a member that has returned while the frame waits for it."""
        self.collection.ask(member)

    def ask_again(self, fragments: list[str]) -> None:
        """Ask for fragments once more: their host is gone, or one has returned."""
        self.evolution.ask_again(fragments)

    def seek(self, frame: int) -> None:
        """Ignored: a live world only goes forward."""

    def members_changed(self, hello: m.Hello | None) -> None:
        """Ignored: live frames wait for members by themselves."""
