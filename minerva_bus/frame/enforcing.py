"""Where norms come into a frame: before its events are told, and before its outcome counts."""

from __future__ import annotations

from minerva_bus.frame.core import Core
from minerva_bus.frame.enforcement import Sources
from minerva_bus.world.norms import SOURCE


class Enforcing(Core):
    """The frame's events and outcome as far as the norms leave them."""

    def _allowed(self, sources: Sources) -> Sources:
        """Steps 2 to 4: the events that happen."""
        due, self._sanctions = self._sanctions, []
        if self._enforcement:
            sources = self._enforcement.events(self.frame, sources)
            self._follow_up()
        return {**sources, SOURCE: due} if due else sources

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
