"""What the coordinator lets in: how much of whom, and who may be what.

Zenoh's access control binds a key to a certificate, so who sent something is known by its key;
what its certificate allows, and how much is too much, is looked at here. All that is refused is
counted by name.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final

from minerva_bus.frame.messages import Hello
from minerva_bus.security.credentials import AGENT, GENERATOR, OPERATOR, VIEW, Rights, rights_of
from minerva_bus.wire.limits import DEFAULT, Limits
from minerva_bus.wire.weighing import values_in

READING: Final = frozenset({"status", "totals", "scene", "fragment", "vocabulary", "logs"})
"""Questions that change nothing."""

FOR_ALL: Final = frozenset({"status"})
STRANGERS: Final = "strangers"
MOST_NAMES: Final = 1000
"""Names that are counted one by one; there may be any number of them where nobody is known."""

_MOMENT: Final = 0.001
_MESSAGES, _BYTES, _VALUES = "messages", "bytes", "values"
_SECONDS, _HELLOS, _ALL = "seconds", "hellos", "hellos of all"


class _Allowance:
    """How much somebody may still say now; it fills up with time, to a second's worth."""

    def __init__(self, full: Mapping[str, float], now: float) -> None:
        self._full = full
        self._left = dict(full)
        self._at = now
        self.told = False

    def fill(self, now: float) -> None:
        """Let time have passed."""
        passed = now - self._at
        if passed < _MOMENT:
            return  # In a flood it would cost more than all else.
        self._at = now
        for what, full in self._full.items():
            self._left[what] = min(self._left[what] + passed * full, full)

    def left(self, what: str) -> float:
        """How much of something is left."""
        return self._left[what]

    def take(self, what: str, amount: float) -> bool:
        """Take some of it; False where so much is not left, and then nothing is."""
        left = self._left[what] - amount
        self._left[what] = max(left, 0.0)
        return left >= 0

    def owe(self, what: str, amount: float) -> None:
        """Take some of it, also what is not there yet."""
        self._left[what] -= amount


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
        self._full: Mapping[str, float] = {
            _MESSAGES: limits.messages,
            _BYTES: limits.bytes,
            _VALUES: limits.values,
            _SECONDS: limits.seconds,
            _HELLOS: limits.hellos,
            _ALL: limits.all_hellos,
        }

    def count(self, who: str, times: int = 1) -> None:
        """Something of somebody has been refused."""
        known = who in self.refused or len(self.refused) < MOST_NAMES
        self.refused[who if known else STRANGERS] += times

    def counts(self) -> dict[str, int]:
        """The number of rejections by name."""
        return dict(sorted(self.refused.items()))

    # --- how much ---

    def has_room(self, who: str, size: int) -> bool:
        """Whether a message of so many bytes is within what a member may say in a second."""
        mine = self._filled(who)
        if not mine.take(_MESSAGES, 1):
            return False
        return mine.take(_BYTES, size) and mine.left(_SECONDS) > 0

    def has_values(self, who: str, data: bytes) -> bool:
        """Whether the values of a message are within what a member may say in a second.

        A message that has more than any may have is let through, to be refused for that.
        """
        mine, most = self._filled(who), self._limits.values
        left = int(mine.left(_VALUES))
        count = values_in(data, left if 2 * left < most else most)
        return mine.take(_VALUES, count) or count > most

    def has_hello(self, who: str) -> bool:
        """Whether one more hello is within what a member, and all of them, may say in a second."""
        return self._filled(who).take(_HELLOS, 1) and self._filled(_ALL).take(_ALL, 1)

    def spent(self, who: str, seconds: float) -> None:
        """To hear what a member has said took so long."""
        self._filled(who).owe(_SECONDS, seconds)

    def _filled(self, who: str) -> _Allowance:
        """What somebody may say now."""
        mine = self._allowances.get(who)
        if mine is None:
            mine = self._allowances[who] = _Allowance(self._full, self._clock())
        mine.fill(self._clock())
        return mine

    def too_much(self, who: str) -> str:
        """What to say of one who says too much, the first time; the empty text after that."""
        self.count(who)
        mine = self._allowances[who]
        if mine.told:
            return ""
        mine.told = True
        limits = self._limits
        return (
            f"says more than {limits.messages} messages, {limits.hellos} hellos,"
            f" {limits.bytes >> 20} MiB or {limits.values} values a second, or what takes"
            f" {limits.seconds:g} s: the rest is not heard (columns are few values; [limits])"
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
