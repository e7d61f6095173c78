"""Goal of a world, which ends when all its agents have sent `until` or `give_up`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from minerva_bus.frame.composition import Composition
from minerva_bus.frame.description import World
from minerva_bus.frame.instructions import Instructions
from minerva_bus.grammar.events import AnyEvent, Events
from minerva_bus.wording import counted

GIVEN_UP: Final = "~given up"
"""Key in `Checkpoint.saved` for the agents that have given up; no member can have this name."""

_MAX_REASONS: Final = 3
"""Maximum number of agents that are named at the end with their reasons for giving up."""


def all_sent(until: str) -> str:
    """Reason for an end by `until`."""
    return f"every agent has sent {until}"


class WorldGoal:
    """The agents that have sent `until`, and those that have sent `give_up`.

    `reached`: agents that have sent `until`; `striving`: the kinds of agents that send either.
    """

    def __init__(
        self, world: World, composition: Composition, saved: dict[str, Mapping[str, Any]]
    ) -> None:
        """`saved` is the world's saved state, which keeps the agents that have given up."""
        self._until, self._give_up = world.until, world.give_up
        self._composition = composition
        self._saved = saved
        self.reached = world.past.reached
        self.striving = world.past.reaching

    @property
    def met(self) -> bool:
        """Whether every agent of the kinds that send `until` has sent it."""
        return bool(self.finished) and not self.given_up

    @property
    def finished(self) -> str:
        """Reason for the end if every agent has sent `until` or given up, otherwise empty."""
        if not self._until:
            return ""
        done = self.reached.union(self.given_up)
        # Kinds count once one of their agents has sent an event. Before that no agent strives for
        # the goal, and the empty set would seem complete.
        composition = self._composition
        striving = (who for who in composition.agents() if composition.kind(who) in self.striving)
        if not (done and done.issuperset(striving)):
            return ""
        given_up = self.given_up
        reasons = [f"#{agent} has given up: {given_up[agent]}" for agent in sorted(given_up)]
        over = len(reasons) - _MAX_REASONS
        more = [f"and {over} more"] if over > 0 else []
        return "; ".join([*reasons[:_MAX_REASONS], *more]) or all_sent(self._until)

    @property
    def given_up(self) -> Mapping[str, Any]:
        """Agents that have sent `give_up` and not `until` since, with the event as text."""
        return self._saved.get(GIVEN_UP, {})

    def note(self, sent: Mapping[str, tuple[AnyEvent, ...]], out: Instructions) -> None:
        """Note the agents that have sent `until` or `give_up`; `sent` is by agent or fragment.

        Kinds are noted before the frame's changes count, because the sender may be gone then.
        """
        ends = {self._until, self._give_up} - {""}  # A world without a goal has empty types.
        for name, events in sent.items() if ends else ():
            ending = [event for event in events if event.type in ends]
            for event in ending:
                self._note_event(event, out)
            if ending:
                part = self._composition.parts.get(name)
                kind = part.symbol if part is not None else self._composition.kind(name)
                self.striving = self.striving.union((kind,))

    def _note_event(self, event: AnyEvent, out: Instructions) -> None:
        batch = isinstance(event, Events)
        senders = tuple(event.senders or ()) if batch else (event.sender,)
        given_up = self.given_up
        if event.type == self._until:
            self.reached = self.reached.union(senders)
            # Reaching the goal later supersedes giving up.
            given_up = {name: why for name, why in given_up.items() if name not in senders}
        else:
            why = event.type if batch else f"{event.type}<{event.data_text()}>"
            given_up = {**given_up, **dict.fromkeys(senders, why)}
            who = senders[0] if len(senders) == 1 else counted(len(senders), "agent")
            out.log(who, f"gave up: {why}")
        if given_up or GIVEN_UP in self._saved:
            self._saved[GIVEN_UP] = given_up
