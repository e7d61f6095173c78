"""For whom a frame waits, since when, and what becomes of it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

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

START: Final = 10.0
"""Seconds that a member has at least to start and join."""

FEW: Final = 3
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

    def of(self, member: str, in_frame: bool) -> Patience:
        """The patience with a member; whoever has yet to come has time to start."""
        if in_frame:
            return self.own.get(member, self.all)
        return Patience(self.all.soft, max(self.all.hard, START), "restart")


@dataclass(slots=True)
class _Wait:
    since: float
    told: float = 0.0
    done: bool = False


class Waits:
    """The members that a step of a frame waits for; times are seconds of one monotonic clock."""

    def __init__(self, deadlines: Deadlines) -> None:
        self._deadlines = deadlines
        self._step: object = None
        self._in_frame = False
        self._waits: dict[str, _Wait] = {}

    def look(self, step: object, in_frame: bool, waiting: Iterable[str], now: float) -> float:
        """Note for whom a step waits now; for how many seconds it has waited for the first."""
        self._in_frame = in_frame
        if step != self._step:
            self._step, self._waits = step, {}
        self._waits = {name: self._waits.get(name, _Wait(now)) for name in sorted(waiting)}
        return max((now - wait.since for wait in self._waits.values()), default=0.0)

    def patience(self, member: str) -> Patience:
        """The patience with a member in this step."""
        return self._deadlines.of(member, self._in_frame)

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

    def unsaid(self, now: float) -> list[str]:
        """Those of whom it is time to say it, which then is: ever more seldom."""
        found: list[str] = []
        for name, wait in self._waits.items():
            waited = now - wait.since
            if waited >= self.patience(name).soft and waited >= 2 * wait.told:
                wait.told = waited
                found.append(name)
        return found

    def told(
        self, unsaid: Sequence[str], guests: Collection[str], now: float
    ) -> Iterator[tuple[str, str]]:
        """Whom to say it of, and how long they have been waited for; nobody, of them together.

        `guests` are no processes of the world file, so that nobody starts them anew.
        """
        waited = {name: self.since(name, now) for name in unsaid}
        if len(unsaid) <= FEW:
            for name in unsaid:
                outlook = self.outlook(name, waited[name], name in guests)
                yield name, f"it for {waited[name]:.1f} s{outlook}"
            return
        names = f"{', '.join(unsaid[:FEW])} and {len(unsaid) - FEW} more"
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
