"""Where norms come into a frame: before its events are told, and before its outcome counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from minerva_bus.frame.checkpoint import HALTED
from minerva_bus.frame.core import Core
from minerva_bus.frame.enforcement import PEOPLE, Sources
from minerva_bus.frame.trial import Trial
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.scene import Scene, agents
from minerva_bus.world.norms import SOURCE


class Enforcing(Core):
    """The frame's events and outcome as far as the norms leave them."""

    def _allowed(self, sources: Sources) -> Sources:
        """Steps 2 to 4: the events that happen."""
        due, self._sanctions = self._sanctions, []
        if self._enforcement:
            sources = self._enforcement.events(self.frame, sources, self._people)
            self._follow_up()
        return {**sources, SOURCE: due} if due else sources

    def _standing_for_people(self, sources: Sources) -> tuple[str, ...]:
        """The sources of a frame that stand for people; who they are matters to norms alone."""
        if not self._enforcement:
            return ()
        return tuple(sorted(self.members.standing_for_people().intersection(sources)))

    def _orders_allowed(self, orders: Sequence[AnyEvent]) -> tuple[AnyEvent, ...]:
        """What the norms leave of people's orders, before a generator takes them."""
        if not self._enforcement or not orders:
            return tuple(orders)
        left = self._enforcement.events(self.frame, {PEOPLE: orders})
        self._follow_up()
        return tuple(left[PEOPLE])

    def _try_outcome(self) -> Trial | None:
        """Step 5: judge what agents become."""
        if not self._enforcement:
            return None
        trial = self._enforcement.agents(self.frame, self._changed, self._sent)
        self._follow_up()
        return trial

    def _fewer_events(self) -> Iterator[tuple[AnyEvent, ...]]:
        """The events of the frame, ever fewer, by which those who are refused may still go on."""
        if self._trial is None:
            return iter(())
        return self._enforcement.stages(self._trial, self._evolving)

    def _enforce(self) -> tuple[str, ...]:
        """Let what the norms leave be the outcome; the fragments of which they refuse something."""
        overruled: tuple[str, ...] = ()
        halted = set(self._agents_left_out() if self._visual else ())
        if self._trial is not None:
            ruling = self._enforcement.ruling(self._trial)
            self._changed, self._sent, overruled = ruling.changed, ruling.sent, ruling.overruled
            halted.update(ruling.halted)
        self._halt(tuple(sorted(halted)))
        return overruled

    def _agents_left_out(self) -> Iterator[str]:
        """The agents that nobody has evolved in this frame although events were there for them."""
        for name in self._left_out & self.composition.fragments.keys():
            fragment = self.composition.fragments[name]
            ids = fragment.ids if isinstance(fragment, Columns) else None
            if ids is not None:
                yield from ids.texts()
            else:
                yield from (one.id for one in agents(Scene((fragment,))))

    def _halt(self, halted: tuple[str, ...]) -> None:
        """These carry out nothing in this frame, which a world that goes on has to know."""
        self._halted = halted
        if halted:
            self._saved[HALTED] = {"frame": self.frame, "agents": list(halted)}

    def _follow_up(self) -> None:
        """Say, send and keep what follows from broken norms."""
        for words in self._enforcement.take_words():
            self._say("norms", words)
        self._sanctions += self._enforcement.take_sanctions()
        self._saved[SOURCE] = self._enforcement.saved()
