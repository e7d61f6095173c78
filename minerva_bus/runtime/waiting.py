"""For whom a frame waits, since when, and what becomes of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from minerva_bus.wording import named_some

THEN: Final = {
    "restart": "it is started anew",
    "skip": "the frame goes on without it",
    "wait": "",
    "stop": "the world stops",
}
"""What is done with a member that has been waited for too long, and how that is said."""


FAILED: Final = {
    "restart": THEN["restart"],
    "stop": "it is killed, and the world stops,",
    "ignore": "it is killed, and the world goes on without it,",
}
"""What becomes of a process that does not answer, by what its `on_failure` is."""

START: Final = 30.0
"""Seconds that a member has at least from its process's start to its hello."""

TIMES_SLOWEST_SAID: Final = 2.0
TIMES_SLOWEST: Final = 10.0
"""How many times the slowest start so far one takes until it is said, and until it is restarted,
where that is more: a machine that is busy with other things is slow for all."""

STARTS_SAID_EVERY: Final = 2.0
"""Seconds between two lines about members that the world waits for before it begins."""

MAX_NAMED: Final = 3
"""Members that are waited for and named one by one."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a frame waits for a member: seconds until it is said, and until `then` is done."""

    soft: float = 1.0
    hard: float = 30.0
    then: str = "restart"

    def outlook(self, waited: float, on_failure: str = "restart") -> str:
        """What happens when, as it is said; nothing where it is waited for without end."""
        done = FAILED[on_failure] if self.then == "restart" else THEN[self.then]
        return f"; {done} in {max(0.0, self.hard - waited):.0f} s" if done else ""


@dataclass(frozen=True, slots=True)
class Deadlines:
    """The patience with each member: its own, or that with all.

    `elsewhere` are those whom nobody here can start anew, `on_failure` what becomes of others.
    """

    all: Patience = field(default_factory=Patience)
    own: Mapping[str, Patience] = field(default_factory=dict[str, Patience])
    elsewhere: frozenset[str] = frozenset()
    on_failure: Mapping[str, str] = field(default_factory=dict[str, str])

    def of(self, member: str) -> Patience:
        """The patience with a member that takes part."""
        return self.own.get(member, self.all)

    def with_start(self, slowest: float) -> Patience:
        """The patience with a member that starts, where the slowest start took so many seconds."""
        soft = max(self.all.soft, TIMES_SLOWEST_SAID * slowest)
        return Patience(soft, max(self.all.hard, START, TIMES_SLOWEST * slowest, soft), "restart")


@dataclass(slots=True)
class _Wait:
    since: float
    told: float = 0.0
    done: bool = False


class Waits:
    """The members that a step of a frame waits for; times are seconds of one monotonic clock.

    `queued` are those whose processes have yet to be started: nobody waits for them so far.
    """

    def __init__(self, deadlines: Deadlines, queued: Iterable[str] = ()) -> None:
        self._deadlines = deadlines
        self._step: object = None
        self._in_frame = False
        self._waits: dict[str, _Wait] = {}
        self._queued = set(queued)
        self._starting: dict[str, float] = {}
        self._slowest = 0.0
        self._said_at = float("-inf")

    def started(self, member: str, now: float) -> None:
        """A member's process starts now: it is waited for from now on."""
        self._queued.discard(member)
        self._starting[member] = now
        self._waits.pop(member, None)

    def arrived(self, member: str, now: float) -> bool:
        """A member has said hello; whether its process was known to start."""
        since = self._starting.pop(member, None)
        if since is None:
            return False
        self._slowest = max(self._slowest, now - since)
        self._waits.pop(member, None)  # Its start took what it took: a frame waits from now on.
        return True

    def update(self, step: object, in_frame: bool, waiting: Iterable[str], now: float) -> float:
        """Note for whom a step waits now; for how many seconds it has waited for the first."""
        self._in_frame = in_frame
        if step != self._step:
            self._step, self._waits = step, {}
        names = sorted(set(waiting) - self._queued)
        self._waits = {name: self._waits.get(name) or self._begun(name, now) for name in names}
        return max((now - wait.since for wait in self._waits.values()), default=0.0)

    def _begun(self, member: str, now: float) -> _Wait:
        return _Wait(self._starting.get(member, now))

    def patience(self, member: str) -> Patience:
        """The patience with a member in this step: whoever has yet to come has time to start."""
        own = self._deadlines.of(member)
        joined = self._in_frame and member not in self._starting
        if joined or (self._in_frame and own.then != "restart"):
            return own
        return self._deadlines.with_start(self._slowest)

    def outlook(self, member: str, waited: float, guest: bool) -> str:
        """What becomes of a member that has been waited for so long, and when, as it is said."""
        patience = self.patience(member)
        if patience.then == "restart" and member in self._deadlines.elsewhere:
            return "; it runs elsewhere, and may come back from there"
        if patience.then == "restart" and guest:
            left = max(0.0, patience.hard - waited)
            return f"; it is put out of the world in {left:.0f} s: attach it anew where it runs"
        return patience.outlook(waited, self._deadlines.on_failure.get(member, "restart"))

    def since(self, member: str, now: float) -> float:
        """For how many seconds this one is waited for."""
        return now - self._waits[member].since

    def reportable(self, now: float) -> list[str]:
        """Those of whom it is time to say it, which then is: ever more seldom."""
        if not self._in_frame and now < self._said_at + STARTS_SAID_EVERY:
            return []
        found: list[str] = []
        for name, wait in self._waits.items():
            waited = now - wait.since
            if waited >= self.patience(name).soft and waited >= 2 * wait.told:
                wait.told = waited
                found.append(name)
        self._said_at = now if found else self._said_at
        return found

    def describe(
        self, unsaid: Sequence[str], guests: Collection[str], now: float
    ) -> Iterator[tuple[str, str]]:
        """Whom to say it of, and how long they have been waited for; nobody, of them together.

        `guests` are no processes of the world file, so that nobody starts them anew.
        """
        waited = {name: self.since(name, now) for name in unsaid}
        if len(unsaid) <= (MAX_NAMED if self._in_frame else 1):
            for name in unsaid:
                outlook = self.outlook(name, waited[name], name in guests)
                yield name, f"it for {waited[name]:.1f} s{outlook}"
            return
        names = named_some(unsaid, MAX_NAMED)
        longest = max(unsaid, key=lambda name: waited[name])
        outlook = self.outlook(longest, waited[longest], longest in guests)
        yield "", f"{names} for {waited[longest]:.1f} s{outlook}"

    def overdue(self, now: float) -> list[tuple[str, str]]:
        """Those who were waited for too long, and what is to be done, each once in a step."""
        found: list[tuple[str, str]] = []
        for name, wait in self._waits.items():
            patience = self.patience(name)
            late = now - wait.since >= patience.hard and not wait.done
            if late and patience.then != "wait":
                wait.done = True
                found.append((name, patience.then))
        return found

    def again(self, member: str, now: float) -> None:
        """Begin to wait for a member anew."""
        self._waits[member] = _Wait(now)
