"""Where norms come into a frame: before its events are told, and before its outcome counts."""

from __future__ import annotations

from collections.abc import Sequence

from minerva_bus.frame.core import Core
from minerva_bus.frame.enforcement import PEOPLE, Sources
from minerva_bus.grammar.batch import AnyEvent
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
        return tuple(sorted(self.roster.stand_for_people().intersection(sources)))

    def _orders_allowed(self, orders: Sequence[AnyEvent]) -> tuple[AnyEvent, ...]:
        """What the norms leave of people's orders, before a generator takes them."""
        if not self._enforcement or not orders:
            return tuple(orders)
        left = self._enforcement.events(self.frame, {PEOPLE: orders})
        self._follow_up()
        return tuple(left[PEOPLE])

    def _enforce(self) -> tuple[str, ...]:
        """Step 5: what agents become; the fragments that are not what their hosts have made."""
        if not self._enforcement:
            return ()
        ruling = self._enforcement.agents(self.frame, self._changed, self._sent)
        self._changed, self._sent = ruling.changed, ruling.sent
        self._follow_up()
        return ruling.overruled

    def _follow_up(self) -> None:
        """Say, send and keep what follows from broken norms."""
        for words in self._enforcement.take_words():
            self._say("norms", words)
        self._sanctions += self._enforcement.take_sanctions()
        self._saved[SOURCE] = self._enforcement.saved()
