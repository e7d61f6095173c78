"""What the coordinator lets in: how much of whom, and who may be what.

Zenoh's access control binds a key to a certificate, so who sent something is known by its key;
what its certificate allows, and how much is too much, is looked at here. All that is refused is
counted by name.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from minerva_bus.bus.credentials import AGENT, GENERATOR, OPERATOR, VIEW, Rights, rights_of
from minerva_bus.frame.messages import Hello
from minerva_bus.protocol.limits import DEFAULT, Limits

READING: Final = frozenset({"status", "totals", "scene", "fragment", "vocabulary", "logs"})
"""Questions that change nothing."""

FOR_ALL: Final = frozenset({"status"})
STRANGERS: Final = "strangers"
MOST_NAMES: Final = 1000
"""Names that are counted one by one; there may be any number of them where nobody is known."""

_ANSWERS: Final = (b"\xa6ticked", b"\xa7evolved", b"\xa6report")
"""How messages begin that a frame may wait for, behind the mark of a list."""


@dataclass(slots=True)
class _Allowance:
    """How much somebody may still say now; it fills up with time, to a second's worth."""

    messages: float
    bytes: float
    at: float
    told: bool = False


class Gate:
    """Guards one world.

    `rights` gives what certificates allow, by common names; without it all may do all.
    """

    def __init__(
        self,
        limits: Limits = DEFAULT,
        rights: Callable[[], Mapping[str, Rights]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.refused: Counter[str] = Counter()
        self._limits = limits
        self._rights = rights
        self._clock = clock
        self._allowances: dict[str, _Allowance] = {}

    def count(self, who: str, times: int = 1) -> None:
        """Something of somebody has been refused."""
        known = who in self.refused or len(self.refused) < MOST_NAMES
        self.refused[who if known else STRANGERS] += times

    # --- how much ---

    def has_room(self, who: str, size: int) -> bool:
        """Whether a message of so many bytes is within what a member may say in a second."""
        limits, now = self._limits, self._clock()
        mine = self._allowances.get(who)
        if mine is None:
            mine = _Allowance(limits.messages, limits.bytes, now)
            self._allowances[who] = mine
        passed = now - mine.at
        mine.at = now
        mine.messages = min(mine.messages + passed * limits.messages, limits.messages) - 1
        mine.bytes = min(mine.bytes + passed * limits.bytes, limits.bytes) - size
        if mine.messages >= 0 and mine.bytes >= 0:
            return True
        mine.messages, mine.bytes = max(mine.messages, 0.0), max(mine.bytes, 0.0)
        return False

    def too_much(self, who: str) -> str:
        """What to say of one who says too much, the first time; the empty text after that."""
        self.count(who)
        mine = self._allowances[who]
        if mine.told:
            return ""
        mine.told = True
        limits = self._limits
        return (
            f"says more than {limits.messages} messages or {limits.bytes >> 20} MiB a second: the"
            " rest is not heard ([limits])"
        )

    # --- who ---

    def shut_out(self, who: str) -> str:
        """Why nothing at all of somebody is heard, or the empty text."""
        mine = self._of(who)
        return "its certificate was revoked" if mine is not None and mine.revoked else ""

    def objection(self, hello: Hello) -> str:
        """Why a member may not be what it says it is, or the empty text."""
        mine = self._of(hello.member)
        if mine is None:
            return ""
        if mine.revoked:
            return self.shut_out(hello.member)
        makes = hello.generates or hello.publishes or hello.orders or hello.ticks
        kinds = [kind.name for kind in hello.kinds]
        faces = ((AGENT, kinds), (GENERATOR, makes), (VIEW, hello.draws))
        for role, shown in faces:
            if shown and not mine.may(role):
                roles = ", ".join(sorted(mine.roles))
                return f"its certificate is for {roles}, not for {role}"
        return (
            _beyond("agents", kinds, mine.kinds)
            or _beyond("events", hello.generates, mine.events)
            or _beyond("topics", hello.publishes, mine.topics)
        )

    def objection_to_question(self, who: str, orders: bool, question: object) -> str:
        """Why a question is not answered, or the empty text.

        `who` has come by a certificate of that name; nobody: from this machine. `orders`: on the
        key on which orders may be given.
        """
        if not orders and question not in READING:
            return f"{who} may give no orders: its certificate is for no {OPERATOR}"
        mine = self._of(who) if who else None
        if mine is None:
            return ""
        if mine.revoked:
            return f"the certificate of {who} was revoked"
        if question in READING and not (mine.may(VIEW, OPERATOR) or question in FOR_ALL):
            return f"{who} may not read the world: its certificate is for no {VIEW} or {OPERATOR}"
        if question not in READING and not mine.may(OPERATOR):
            return f"{who} may give no orders: its certificate is for no {OPERATOR}"
        return ""

    def _of(self, who: str) -> Rights | None:
        return rights_of(who, self._rights()) if self._rights is not None else None


def _beyond(what: str, shown: tuple[str, ...] | list[str], confined: frozenset[str]) -> str:
    beyond = sorted(set(shown) - confined) if confined else []
    if not beyond:
        return ""
    allowed = ", ".join(sorted(confined))
    return f"its certificate is for the {what} {allowed}, not for {', '.join(beyond)}"


def may_be_awaited(data: bytes, offset: int) -> bool:
    """Whether a message, which begins behind so many bytes, is of those that a frame waits for."""
    return data.startswith(_ANSWERS, offset + 1)
