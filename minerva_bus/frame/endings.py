"""When a world is over: its agents have sent what it runs until, or have given up."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from minerva_bus.frame.enforcing import Enforcing
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.wording import counted

GIVEN_UP: Final = "~given up"
"""The name under which a checkpoint has who has given up; no member can have it."""

_REASONS: Final = 3
"""So many of those who have given up are named at the end."""


class Endings(Enforcing):
    """Which agents have sent `until`, and which `give_up`."""

    @property
    def reached(self) -> bool:
        """Whether every agent of the kinds that send `until` has sent it."""
        return bool(self.finished) and not self._given_up()

    @property
    def finished(self) -> str:
        """That every agent has sent `until`, or has given up, in words; empty while one has not."""
        given_up = self._given_up()
        done = self._reached.union(given_up)
        if not (self.world.until and done and done.issuperset(self._striving())):
            return ""
        shown = [f"#{agent} has given up: {given_up[agent]}" for agent in sorted(given_up)]
        more = [f"and {len(shown) - _REASONS} more"] if len(shown) > _REASONS else []
        return "; ".join([*shown[:_REASONS], *more]) or f"every agent has sent {self.world.until}"

    def _striving(self) -> Iterable[str]:
        """The agents of the kinds that send `until` or `give_up`."""
        composition = self.composition
        return (one for one in composition.agents() if composition.kind(one) in self._reaching)

    def _given_up(self) -> Mapping[str, Any]:
        """Who has sent `give_up`, and not `until` since: its event, as a text."""
        return self._saved.get(GIVEN_UP, {})

    def _note_ends(self) -> None:
        """Note who has sent `until` or `give_up`, and of what kind; it may be gone soon."""
        ends = {self.world.until, self.world.give_up} - {""}
        for name, events in self._sent.items() if ends else ():
            sent = [event for event in events if event.type in ends]
            for event in sent:
                self._note_end(event)
            if sent:
                part = self.composition.parts.get(name)
                kind = part.symbol if part is not None else self.composition.kind(name)
                self._reaching = self._reaching.union((kind,))

    def _note_end(self, event: AnyEvent) -> None:
        many = isinstance(event, Events)
        senders = tuple(event.senders or ()) if many else (event.sender,)
        given_up = self._given_up()
        if event.type == self.world.until:
            self._reached = self._reached.union(senders)
            given_up = {name: why for name, why in given_up.items() if name not in senders}
        else:
            why = event.type if many else f"{event.type}<{event.data_text()}>"
            given_up = {**given_up, **dict.fromkeys(senders, why)}
            who = senders[0] if len(senders) == 1 else counted(len(senders), "agent")
            self._say(who, f"gave up: {why}")
        if given_up or GIVEN_UP in self._saved:
            self._saved[GIVEN_UP] = given_up
