"""Where the events and results of a frame come from: three small protocols.

`CollectionStep` and `EvolutionStep` take them from members, `RecordedSource` from a record.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.members import MemberEntry


class InputSteps(Protocol):
    """Steps 2 to 4 of Table 2."""

    def begin(self) -> None:
        """Request the events of the frame that begins."""
        ...

    def collect(self) -> None:
        """The events of the frame."""
        ...


class OutcomeSteps(Protocol):
    """Steps 5, 6 and 8 of Table 2."""

    def evolve(self) -> None:
        """Steps 5 and 6: request the next string and the views."""
        ...

    def settle(self) -> bool:
        """Whether the results are final, with norms applied; otherwise more are requested."""
        ...

    def commit(self) -> None:
        """Step 8: w = w_next and t = t + 1."""
        ...


@dataclass(frozen=True, slots=True)
class MemberAnswers:
    """What accepts the answers of members and the orders of people, and repeats requests.

    `tick_reply`, `evolve_reply` and `emitted` return the reason if a message violates the protocol,
    otherwise an empty string.
    `ask`: repeat the request to a generator that has returned while the frame waits for it.
    `ask_again`: request fragments once more, because their host is gone, or one has returned.
    `lighten`: repeat a frame that has ended a host twice by fewer events; False if it cannot.
    """

    tick_reply: Callable[[m.TickReply], str]
    evolve_reply: Callable[[m.EvolveReply], str]
    emitted: Callable[[m.Emitted], str]
    order: Callable[[s.Publish], None]
    ask: Callable[[MemberEntry], None]
    ask_again: Callable[[list[str]], None]
    lighten: Callable[[str], bool]
