"""Who takes part: one table of states and what moves a member between them.

       appeared          greeted           admitted
(none) ────────▶ JOINING ───────▶ JOINING ────────▶ PRESENT ◀──▶ LATE
                    ▲                                  │ vanished  │
                    │ appeared                         ▼           ▼
                   LEFT ◀─── gave up, or went ──────── LOST ◀──────

A member that goes of its own will says so, and its token vanishes. Either may be heard first: Zenoh
sends what concerns tokens before data.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from minerva_bus.frame.messages import Figures, Hello


class State(Enum):
    """Where a member stands."""

    JOINING = "joining"
    PRESENT = "present"
    LATE = "late"
    LOST = "lost"
    LEFT = "left"


class Change(Enum):
    """What can happen to a member."""

    APPEARED = "appeared"
    ADMITTED = "admitted"
    SILENT = "silent"
    ANSWERED = "answered"
    VANISHED = "vanished"
    GAVE_UP = "gave up"
    WENT = "went"


TRANSITIONS: dict[tuple[State, Change], State] = {
    (State.JOINING, Change.ADMITTED): State.PRESENT,
    (State.JOINING, Change.VANISHED): State.LOST,
    (State.JOINING, Change.WENT): State.LEFT,
    (State.PRESENT, Change.SILENT): State.LATE,
    (State.PRESENT, Change.VANISHED): State.LOST,
    (State.PRESENT, Change.WENT): State.LEFT,
    (State.LATE, Change.ANSWERED): State.PRESENT,
    (State.LATE, Change.VANISHED): State.LOST,
    (State.LATE, Change.WENT): State.LEFT,
    (State.LOST, Change.APPEARED): State.JOINING,
    (State.LOST, Change.GAVE_UP): State.LEFT,
    (State.LOST, Change.WENT): State.LEFT,
    (State.LEFT, Change.APPEARED): State.JOINING,
}


@dataclass(slots=True)
class Member:
    """One member as the coordinator knows it.

    `expected`: the world file names it, so the world waits for it until it is given up.
    `drained`: it shall host no agents that another one can.
    `dropped`: how many of its events came when too many waited already.
    `figures`: how it does, as it says itself.
    `joins`: how often a process of this name has joined.
    `blamed`: since it came, it has been said what it did wrong.
    `greeted`: the hello is of the process that is there now, not of one before it.
    """

    name: str
    expected: bool = False
    state: State = State.LEFT
    hello: Hello | None = None
    greeted: bool = False
    last_reply: int = -1
    late: int = 0
    drained: bool = False
    dropped: int = 0
    figures: Figures = field(default_factory=dict[str, bool | int | float | str])
    joins: int = 0
    blamed: bool = False

    def change(self, change: Change) -> bool:
        """Move by the table; False where the table has no such move."""
        after = TRANSITIONS.get((self.state, change))
        if after is not None:
            self.state = after
        return after is not None

    @property
    def ticks(self) -> bool:
        """Whether it is one that is asked in every tick."""
        return self.hello is not None and self.hello.ticks

    @property
    def here(self) -> bool:
        """Whether it takes part in frames now."""
        return self.state in (State.PRESENT, State.LATE)

    @property
    def needed(self) -> bool:
        """Whether there is no frame without it: of those who watch only, the first one is."""
        return self.expected and not (self.hello is not None and self.hello.watches_only)

    @property
    def awaited(self) -> bool:
        """Whether the world waits for it to come (back)."""
        return self.needed and self.state in (State.JOINING, State.LOST)
