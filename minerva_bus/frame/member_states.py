"""States of a member: one table of transitions, and the entry that goes through them.

       appeared          greeted           admitted
(none) ────────▶ JOINING ───────▶ JOINING ────────▶ PRESENT ◀──▶ LATE
                    ▲                                  │ vanished  │
                    │ appeared                         ▼           ▼
                   LEFT ◀─── gave up, or left ──────── LOST ◀──────

A member that leaves of its own accord sends `Leaving`, and its token vanishes. Either may arrive
first, because Zenoh delivers token changes before data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from minerva_bus.frame.messages import Figures, Hello


class MemberState(Enum):
    """State of a member."""

    JOINING = "joining"
    PRESENT = "present"
    LATE = "late"
    LOST = "lost"
    LEFT = "left"


class MemberChange(Enum):
    """Events in the life of a member."""

    APPEARED = "appeared"
    ADMITTED = "admitted"
    SILENT = "silent"
    ANSWERED = "answered"
    VANISHED = "vanished"
    GAVE_UP = "gave up"
    WENT = "went"


TRANSITIONS: Final[Mapping[tuple[MemberState, MemberChange], MemberState]] = {
    (MemberState.JOINING, MemberChange.ADMITTED): MemberState.PRESENT,
    (MemberState.JOINING, MemberChange.VANISHED): MemberState.LOST,
    (MemberState.JOINING, MemberChange.WENT): MemberState.LEFT,
    (MemberState.PRESENT, MemberChange.SILENT): MemberState.LATE,
    (MemberState.PRESENT, MemberChange.VANISHED): MemberState.LOST,
    (MemberState.PRESENT, MemberChange.WENT): MemberState.LEFT,
    (MemberState.LATE, MemberChange.ANSWERED): MemberState.PRESENT,
    (MemberState.LATE, MemberChange.VANISHED): MemberState.LOST,
    (MemberState.LATE, MemberChange.WENT): MemberState.LEFT,
    (MemberState.LOST, MemberChange.APPEARED): MemberState.JOINING,
    (MemberState.LOST, MemberChange.GAVE_UP): MemberState.LEFT,
    # The token vanished first and `Leaving` arrives after it.
    (MemberState.LOST, MemberChange.WENT): MemberState.LEFT,
    (MemberState.LEFT, MemberChange.APPEARED): MemberState.JOINING,
}


@dataclass(slots=True)
class MemberEntry:
    """One member: a row of the table `Members`.

    `expected`: the world file names it, so the world waits for it until it is given up.
    `greeted`: `hello` is from the current process, not from one before it.
    `late`: number of replies that arrived too late to count.
    `drained`: it hosts no agents that another host can evolve.
    `dropped`: number of its events that were discarded.
    `figures`: its metrics, as it last reported them.
    `joins`: number of times a process of this name has joined.
    `blamed`: a violation was logged since it appeared.
    `rests`: if it is asked on orders, it need not be asked before it gets some.
    """

    name: str
    expected: bool = False
    state: MemberState = MemberState.LEFT
    hello: Hello | None = None
    greeted: bool = False
    last_reply: int = -1
    late: int = 0
    drained: bool = False
    dropped: int = 0
    figures: Figures = field(default_factory=dict[str, bool | int | float | str])
    joins: int = 0
    blamed: bool = False
    rests: bool = False

    def change(self, change: MemberChange) -> bool:
        """Apply the transition table; False if it has no such transition."""
        after = TRANSITIONS.get((self.state, change))
        if after is not None:
            self.state = after
        return after is not None

    @property
    def ticks(self) -> bool:
        """Whether frames wait for its answers to ticks."""
        return self.hello is not None and self.hello.ticks

    @property
    def active(self) -> bool:
        """Whether it takes part in frames."""
        return self.state in (MemberState.PRESENT, MemberState.LATE)

    @property
    def needed(self) -> bool:
        """Whether frames require it. A member that only watches is required until it joins."""
        return self.expected and not (self.hello is not None and self.hello.watches_only)

    @property
    def awaited(self) -> bool:
        """Whether the world waits for it to join or to return."""
        return self.needed and self.state in (MemberState.JOINING, MemberState.LOST)
