"""Rules of admission: roles that a certificate allows, and limits per second and member.

Zenoh's access control binds each key to a certificate, so the key identifies the sender. Roles and
limits are checked here. All rejections are counted by name.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Final

from minerva_bus.frame.messages import Hello
from minerva_bus.security.credentials import (
    AGENT,
    GENERATOR,
    OPERATOR,
    VIEW,
    Rights,
    rights_of,
)
from minerva_bus.wire.message_limits import DEFAULT, Limits, values_in

READING: Final = frozenset(
    {"status", "totals", "series", "scene", "fragment", "vocabulary", "logs", "orders"}
)
"""Questions that do not change the world."""

FOR_ALL: Final = frozenset({"status"})
STRANGERS: Final = "strangers"
GUESTS: Final = "~guests"
"""Whose buckets the tokens of all that take no part share."""

MAX_NAMES: Final = 1000
"""Maximum number of names counted separately: without certificates, names are unlimited."""

_MOMENT: Final = 0.001
_MESSAGES, _BYTES, _VALUES = "messages", "bytes", "values"
_SECONDS, _HELLOS, _ALL = "seconds", "hellos", "hellos of all"
_TOKENS, _ALL_TOKENS = "tokens", "tokens of all"


class _Allowance:
    """Token buckets of one sender; each holds up to one second's worth. Last filled `at`."""

    def __init__(self, full: Mapping[str, float], now: float) -> None:
        self._full = full
        self._left = dict(full)
        self.at = now
        self.logged = False

    def fill(self, now: float) -> None:
        """Refill the buckets for the time that has passed."""
        passed = now - self.at
        if passed < _MOMENT:
            return  # In a flood, refilling would cost more than everything else.
        self.at = now
        for what, full in self._full.items():
            # Capped at one second's worth, so that an idle member cannot
            # send an unlimited burst.
            self._left[what] = min(self._left[what] + passed * full, full)

    def left(self, what: str) -> float:
        """Amount left in a bucket."""
        return self._left[what]

    def take(self, what: str, amount: float) -> bool:
        """Take an amount; if less is left, empty the bucket and return False."""
        left = self._left[what] - amount
        self._left[what] = max(left, 0.0)
        return left >= 0

    def owe(self, what: str, amount: float) -> None:
        """Take an amount even if that leaves a debt."""
        self._left[what] -= amount


class AdmissionRules:
    """Rules of one world.

    `rights` returns what certificates allow, by common name; without it everything is allowed.
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
            _TOKENS: limits.hellos,
            _ALL_TOKENS: limits.all_hellos,
        }
        of_strangers = min(limits.messages, limits.stranger_messages)
        self._full_of_strangers = {**self._full, _MESSAGES: of_strangers}

    def count(self, who: str, number: int = 1) -> None:
        """Count rejections of a sender."""
        known = who in self.refused or len(self.refused) < MAX_NAMES
        self.refused[who if known else STRANGERS] += number

    def counts(self) -> dict[str, int]:
        """The number of rejections by name."""
        return dict(sorted(self.refused.items()))

    # --- limits ---

    def has_room(self, who: str, size: int) -> bool:
        """Whether a message of this many bytes is within the limits per second."""
        own = self._filled(who)
        if not own.take(_MESSAGES, 1):
            return False
        # Time is charged after the work, so this bucket may be in debt;
        # nothing passes until it is paid.
        return own.take(_BYTES, size) and own.left(_SECONDS) > 0

    def has_values(self, who: str, data: bytes) -> bool:
        """Whether the number of values of a message is within the limits per second.

        A message above the limit per message passes, so that the decoder rejects it with a reason.
        """
        # Counting takes time itself, so the count stops at the sender's remaining allowance.
        own, most = self._filled(who), self._limits.values
        left = int(own.left(_VALUES))
        count = values_in(data, left if 2 * left < most else most)
        return own.take(_VALUES, count) or count > most

    def has_hello(self, who: str) -> bool:
        """Whether another hello is within the limits per second, per sender and in total."""
        # The sender's own bucket is first: a flood from one
        # sender must not empty the common one.
        return self._filled(who).take(_HELLOS, 1) and self._filled(_ALL).take(_ALL, 1)

    def has_token(self, who: str, takes_part: bool) -> bool:
        """Whether a change of a member's token is within the limits per second.

        Names are unlimited, so all that take no part have common limits as well.
        """
        own = self._filled(who)
        if takes_part:
            return own.take(_TOKENS, 1)
        common = self._filled(GUESTS)
        if common.left(_SECONDS) <= 0 or common.left(_ALL_TOKENS) < 1:
            return False
        return own.take(_TOKENS, 1) and common.take(_ALL_TOKENS, 1)

    def spent(self, who: str, seconds: float) -> None:
        """Charge the seconds that processing a message took."""
        self._filled(who).owe(_SECONDS, seconds)

    def _filled(self, who: str) -> _Allowance:
        """The refilled buckets of a sender."""
        own = self._allowances.get(who)
        if own is None:
            if len(self._allowances) >= self._limits.members + MAX_NAMES:
                self._forget()
            full = self._full if who != STRANGERS else self._full_of_strangers
            own = self._allowances[who] = _Allowance(full, self._clock())
        own.fill(self._clock())
        return own

    def _forget(self) -> None:
        """Forget the senders of longest ago: without certificates, names are unlimited."""
        latest = sorted(self._allowances.items(), key=lambda entry: entry[1].at)
        self._allowances = dict(latest[MAX_NAMES:])

    def too_much(self, who: str, number: int = 1) -> str:
        """Count messages or tokens above the limits; the warning for the first, "" after that."""
        self.count(who, number)
        own, limits = self._filled(who), self._limits
        if own.logged:
            return ""
        own.logged = True
        if who == STRANGERS:
            return (
                f"unknown senders send more than {limits.stranger_messages} messages per second,"
                " or their tokens come and go too fast; the rest is only counted"
            )
        return (
            f"sends more than {limits.messages} messages, {limits.hellos} hellos or tokens,"
            f" {limits.bytes >> 20} MiB or {limits.values} values per second, or messages that take"
            f" {limits.seconds:g} s; the rest is dropped (columns are few values; [limits])"
        )

    # --- roles ---

    def shut_out(self, who: str) -> str:
        """Reason for ignoring all messages of a member, or an empty string."""
        own = self._of(who)
        return "its certificate was revoked" if own is not None and own.revoked else ""

    def objection(self, hello: Hello) -> str:
        """Reason why a certificate does not allow the roles in a hello, or an empty string."""
        own = self._of(hello.member)
        if own is None:
            return ""
        if own.revoked:
            return self.shut_out(hello.member)
        makes = hello.generates or hello.publishes or hello.orders or hello.ticks
        kinds = [kind.name for kind in hello.kinds]
        faces = ((AGENT, kinds), (GENERATOR, makes), (VIEW, hello.draws))
        for role, shown in faces:
            if shown and not own.may(role):
                roles = ", ".join(sorted(own.roles))
                return f"its certificate is for {roles}, not for {role}"
        return (
            _beyond("agents", kinds, own.kinds)
            or _beyond("events", hello.generates, own.events)
            or _beyond("topics", hello.publishes, own.topics, explicit=True)
        )

    def objection_to_question(self, who: str, orders: bool, question: object) -> str:
        """Reason for rejecting a question, or an empty string.

        `who` is the name of the certificate, empty for a process of this machine. `orders`: the
        question arrived on the key that also accepts commands.
        """
        if not orders and question not in READING:
            return f"{who} may not send commands: its certificate lacks the role {OPERATOR}"
        own = self._of(who) if who else None
        if own is None:
            return ""
        if own.revoked:
            return f"the certificate of {who} was revoked"
        if question in READING and not (own.may(VIEW, OPERATOR) or question in FOR_ALL):
            return f"{who} may not read the world: its certificate has no role {VIEW} or {OPERATOR}"
        if question not in READING and not own.may(OPERATOR):
            return f"{who} may not send commands: its certificate lacks the role {OPERATOR}"
        return ""

    def _of(self, who: str) -> Rights | None:
        return rights_of(who, self._rights()) if self._rights is not None else None


def _beyond(
    what: str, shown: tuple[str, ...] | list[str], confined: frozenset[str], explicit: bool = False
) -> str:
    """Why a certificate does not allow what is shown; `explicit`: only what it lists."""
    beyond = sorted(set(shown) - confined) if confined or explicit else []
    if not beyond:
        return ""
    if not confined:
        return (
            f"its certificate is for no {what}, not for {', '.join(beyond)} (keys issue --{what})"
        )
    allowed = ", ".join(sorted(confined))
    return f"its certificate is for the {what} {allowed}, not for {', '.join(beyond)}"
