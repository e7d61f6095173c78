"""A case of the conformance suite, as data: requirements, role and the steps of its script."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

from minerva_bus.frame import messages as m
from minerva_conformance.world import MemberRole


class CoordinatorRole(StrEnum):
    """The role of a coordinator under test."""

    COORDINATOR = "coordinator"


Role: TypeAlias = MemberRole | CoordinatorRole


class Tier(StrEnum):
    """What a member can do, from the least."""

    JOINS = "joins"
    PARTICIPATES = "participates"
    EXACT = "exact"
    ROBUST = "robust"


@dataclass(frozen=True, slots=True)
class Deliver:
    """Send a message; the member answers as the reference does.

    `on` is the key, such as `to`, if it is not the usual one; `data` replaces the encoding.
    """

    message: m.ToMember
    on: str = ""
    data: bytes = b""


@dataclass(frozen=True, slots=True)
class PublishReadings:
    """Publish the readings of another member."""

    readings: m.Readings


@dataclass(frozen=True, slots=True)
class SendIgnored:
    """Send bytes that the member must ignore. `epoch`: relative to the coordinator's, or None.

    `may_end`: instead of ignoring them, the member may send `failed` and end. `checked`: whether
    another greeting follows at once, which shows that the member has not answered.
    """

    on: str
    data: bytes
    epoch: int | None = 0
    may_end: bool = False
    checked: bool = True


@dataclass(frozen=True, slots=True)
class Enter:
    """Welcome the member at a frame. `more`: the vocabulary has a key that is not known yet."""

    frame: int = 0
    more: bool = False


@dataclass(frozen=True, slots=True)
class Succeed:
    """From now on the coordinator has a later epoch, without having vanished."""


@dataclass(frozen=True, slots=True)
class Disappear:
    """The coordinator's tokens vanish; the member undeclares its own."""


@dataclass(frozen=True, slots=True)
class Reappear:
    """A coordinator appears, `later` epochs after the last one, and greets the member.

    The member declares its token again. It is welcomed at `frame`, with the data that it saved
    last if `saved`; None: it is not welcomed yet.
    """

    frame: int | None
    later: int = 1
    saved: bool = True
    seed: int | None = None


@dataclass(frozen=True, slots=True)
class CutLink:
    """The member's link is cut; it joins the same coordinator again, and is welcomed at `frame`."""

    frame: int


@dataclass(frozen=True, slots=True)
class Interrupt:
    """The member's process is asked to end (SIGTERM); after `leaving` it sends nothing more."""


@dataclass(frozen=True, slots=True)
class Break:
    """Send a message in which the member's own code fails; it sends `failed` and ends."""

    message: m.ToMember


@dataclass(frozen=True, slots=True)
class StartAgain:
    """The member's process is killed and started again; it joins at `frame` with its saved data."""

    frame: int


@dataclass(frozen=True, slots=True)
class AwaitEnd:
    """The member ends; `failed`: with an exit code other than 0, or None: with any."""

    failed: bool | None = False


Step: TypeAlias = (
    Deliver
    | PublishReadings
    | SendIgnored
    | Enter
    | Succeed
    | Disappear
    | Reappear
    | CutLink
    | Interrupt
    | Break
    | StartAgain
    | AwaitEnd
)


@dataclass(frozen=True, slots=True)
class Case:
    """One check of a member.

    Attributes:
        id: its name, such as `tick.repeated`.
        title: what the member does.
        requirements: identifiers in PROTOCOL.md.
        tier: what the check is about.
        roles: the roles that it applies to.
        steps: what the suite does; the member answers each message as the reference does.
        requires: capabilities without which the case does not apply, such as `orders`.
        joined: whether the member is greeted and welcomed at `frame` before the first step.
        policy: that in its welcome; the case does not apply to a member that does not know it.
        name_taken: whether another process holds the member's name.
        frame: the frame in its welcome.

    """

    id: str
    title: str
    requirements: tuple[str, ...]
    tier: Tier
    roles: Collection[Role]
    steps: tuple[Step, ...] = ()
    requires: frozenset[str] = frozenset()
    joined: bool = True
    policy: str = "sequential"
    name_taken: bool = False
    frame: int = 0

    def __str__(self) -> str:
        return self.id


class CaseOutcome(StrEnum):
    """How a case has ended; `blocked`: the member did not join."""

    PASSED = "passed"
    FAILED = "failed"
    BLOCKED = "blocked"
    NOT_APPLICABLE = "not applicable"


@dataclass(frozen=True, slots=True)
class CaseResult:
    """The outcome of a case: what was sent, and the answers to the last message."""

    case: Case
    role: Role
    outcome: CaseOutcome
    problem: str = ""
    sent: tuple[str, ...] = ()
    expected: tuple[str, ...] = ()
    received: tuple[str, ...] = ()
