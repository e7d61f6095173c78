"""FIPA's interaction protocols as tables: the acts that a role may send in a state.

A protocol has one initiator and one participant: a call to a hundred agents is a hundred
conversations with one id. Both sides apply the same table to what they send and receive, so they
agree on the state.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

from minerva_messages.acts import Act


class Role(StrEnum):
    """The two sides of a conversation."""

    INITIATOR = "initiator"
    PARTICIPANT = "participant"

    @property
    def other(self) -> Role:
        """The other side."""
        return Role.PARTICIPANT if self is Role.INITIATOR else Role.INITIATOR


START: Final = "start"
NOT_UNDERSTOOD: Final = "not-understood"
EXPIRED: Final = "expired"
CANCELLING: Final = "cancelling"

_I, _P = Role.INITIATOR, Role.PARTICIPANT
Step = tuple[str, Role, Act, str]
"""State, role that sends, its act, and the state that follows."""


@dataclass(frozen=True, slots=True)
class Protocol:
    """An interaction protocol; `name` is FIPA's name for it in messages.

    Besides its own steps each has those that FIPA allows in all: either side may send
    `not-understood`, which ends it, and the initiator may `cancel`. States without a step out of
    them are final; `expired` is reached by a deadline, not by an act.
    """

    name: str
    source: str
    own: tuple[Step, ...]
    _steps: dict[tuple[str, str, str], str] = field(init=False, repr=False, compare=False)
    turns: dict[str, frozenset[Role]] = field(init=False, repr=False, compare=False)
    """The roles that may send the next act in a state; final states are missing."""

    def __post_init__(self) -> None:
        steps: dict[tuple[str, str, str], str] = {
            (before, by, act): after for before, by, act, after in self.own
        }
        turns: dict[str, frozenset[Role]] = {}
        for before, by, _, _ in (*self.own, *_CANCELLED):
            # `cancel` and `not-understood` are possible at any time, so they do not define turns.
            turns[before] = turns.get(before, frozenset()) | {by}
        for state in turns:
            # Before the first act there is nothing to cancel, and a
            # second `cancel` would have no effect.
            if state not in (START, CANCELLING):
                steps[state, _I, Act.CANCEL] = CANCELLING
            if state != START:
                steps |= {(state, by, Act.NOT_UNDERSTOOD): NOT_UNDERSTOOD for by in Role}
        steps |= {(before, by, act): after for before, by, act, after in _CANCELLED}
        object.__setattr__(self, "_steps", steps)
        object.__setattr__(self, "turns", turns)

    @property
    def opening(self) -> str:
        """The act that begins the protocol; the first one if there are several."""
        return str(self.own[0][2])

    def after(self, state: str, by: Role, act: str) -> str:
        """The state after an act; empty if the protocol does not allow it."""
        return self._steps.get((state, by, act), "")

    def ends(self, state: str) -> bool:
        """Whether a state is final."""
        return state not in self.turns


_CANCELLED: Final[tuple[Step, ...]] = (
    (CANCELLING, _P, Act.INFORM, "cancelled"),
    (CANCELLING, _P, Act.FAILURE, "not-cancelled"),
)

REQUEST: Final = Protocol(
    "fipa-request",
    "SC00026",
    (
        (START, _I, Act.REQUEST, "requested"),
        ("requested", _P, Act.REFUSE, "refused"),
        ("requested", _P, Act.AGREE, "agreed"),
        ("requested", _P, Act.INFORM, "done"),
        ("requested", _P, Act.FAILURE, "failed"),
        ("agreed", _P, Act.INFORM, "done"),
        ("agreed", _P, Act.FAILURE, "failed"),
    ),
)

QUERY: Final = Protocol(
    "fipa-query",
    "SC00027",
    (
        (START, _I, Act.QUERY_IF, "asked"),
        (START, _I, Act.QUERY_REF, "asked"),
        ("asked", _P, Act.REFUSE, "refused"),
        ("asked", _P, Act.AGREE, "agreed"),
        ("asked", _P, Act.INFORM, "answered"),
        ("asked", _P, Act.FAILURE, "failed"),
        ("agreed", _P, Act.INFORM, "answered"),
        ("agreed", _P, Act.FAILURE, "failed"),
    ),
)

CONTRACT_NET: Final = Protocol(
    "fipa-contract-net",
    "SC00029",
    (
        (START, _I, Act.CFP, "called"),
        ("called", _P, Act.REFUSE, "refused"),
        ("called", _P, Act.PROPOSE, "proposed"),
        ("proposed", _I, Act.REJECT_PROPOSAL, "rejected"),
        ("proposed", _I, Act.ACCEPT_PROPOSAL, "accepted"),
        ("accepted", _P, Act.INFORM, "done"),
        ("accepted", _P, Act.FAILURE, "failed"),
    ),
)

SUBSCRIBE: Final = Protocol(
    "fipa-subscribe",
    "SC00035",
    (
        (START, _I, Act.SUBSCRIBE, "asked"),
        ("asked", _P, Act.REFUSE, "refused"),
        ("asked", _P, Act.AGREE, "subscribed"),
        ("asked", _P, Act.INFORM, "subscribed"),
        ("asked", _P, Act.FAILURE, "failed"),
        ("subscribed", _P, Act.INFORM, "subscribed"),
        ("subscribed", _P, Act.FAILURE, "failed"),
    ),
)

PROPOSE: Final = Protocol(
    "fipa-propose",
    "SC00036",
    (
        (START, _I, Act.PROPOSE, "proposed"),
        ("proposed", _P, Act.ACCEPT_PROPOSAL, "accepted"),
        ("proposed", _P, Act.REJECT_PROPOSAL, "rejected"),
    ),
)

PROTOCOLS: Final = {
    protocol.name: protocol for protocol in (REQUEST, QUERY, CONTRACT_NET, SUBSCRIBE, PROPOSE)
}
"""The protocols by their names in messages."""
