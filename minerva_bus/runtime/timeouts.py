"""The members that a frame waits for: waiting times, time-outs and the resulting actions."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from minerva_bus.values import fast_dataclass
from minerva_bus.wording import duration, named_some

THEN: Final = {
    "restart": "it will be restarted",
    "skip": "the frame continues without it",
    "wait": "the world waits for it without limit",
    "stop": "the world stops",
}
"""The actions after a time-out, with their texts in log lines."""

FAILED: Final = {
    "restart": THEN["restart"],
    "stop": "it will be killed, and the world stops,",
    "ignore": "it will be killed, and the world continues without it,",
}
"""The action that replaces `restart`, by the `on_failure` of a process."""

START: Final = 30.0
"""Minimum time-out in seconds from the start of a member's process to its hello."""

TIMES_SLOWEST_SAID: Final = 2.0
TIMES_SLOWEST: Final = 10.0
"""Multiple of the slowest start so far after which a start is logged, and restarted.

A busy machine slows down the start of all members.
"""

STARTS_SAID_EVERY: Final = 2.0
"""Interval in seconds between log lines about members that have not joined."""

MISSED_AFTER: Final = 5.0
"""Seconds after which a member whose process has ended takes part no more: longer than a lease."""

MAX_NAMED: Final = 3
"""Awaited members that get a log line of their own."""


OUTPUT_SECONDS: Final = 10.0
"""Least time of a member for its last output after the last frame of a world."""


@fast_dataclass
class Patience:
    """Time-outs of a member in seconds: until a warning (`soft`), and until `then` (`hard`)."""

    soft: float = 1.0
    hard: float = 30.0
    then: str = "restart"


@fast_dataclass
class Deadlines:
    """Time-outs of the members: individual ones, or the common ones.

    `elsewhere`: members on other machines, which cannot be restarted from here. `on_failure`: the
    policy for the failure of each other member.
    """

    all: Patience = field(default_factory=Patience)
    own: Mapping[str, Patience] = field(default_factory=dict[str, Patience])
    elsewhere: frozenset[str] = frozenset()
    on_failure: Mapping[str, str] = field(default_factory=dict[str, str])

    def of(self, member: str) -> Patience:
        """The time-outs of a member that has joined."""
        return self.own.get(member, self.all)

    def for_output(self, members: Iterable[str]) -> float:
        """Seconds that members have for their last output after the last frame of a world.

        A picture of a large world takes as long as its views may take, so `hard` applies.
        """
        return max([OUTPUT_SECONDS, *(self.of(member).hard for member in members)])

    def end_of_output(self, members: Iterable[str], stopping: float, ended: float) -> float:
        """When members that still run are killed; times are seconds of one monotonic clock.

        `stopping` is the end of the last frame, `ended` the end of the world. A member that has
        reported has what is left of its time for its last output, at least OUTPUT_SECONDS.
        """
        return max(ended + OUTPUT_SECONDS, stopping + self.for_output(members))

    def with_start(self, slowest: float) -> Patience:
        """The time-outs of a member that starts; the slowest start so far took `slowest` s."""
        soft = max(self.all.soft, TIMES_SLOWEST_SAID * slowest)
        return Patience(soft, max(self.all.hard, START, TIMES_SLOWEST * slowest, soft), "restart")


@dataclass(slots=True)
class _Wait:
    since: float
    done: bool = False


class Waits:
    """The members that a step of a frame waits for; times are seconds of one monotonic clock.

    `queued` are members whose processes have not been started; they are not awaited until then.
    """

    def __init__(self, deadlines: Deadlines, queued: Iterable[str] = ()) -> None:
        self._deadlines = deadlines
        self._step: object = None
        self._in_frame = False
        self._waits: dict[str, _Wait] = {}
        self._queued = set(queued)
        self._starting: dict[str, float] = {}
        # Per member: a member that is restarted in this step is not reported from the beginning.
        self._reported: dict[str, float] = {}
        self._slowest = 0.0
        self._last_report = float("-inf")

    def started(self, member: str, now: float) -> None:
        """Note the start of a member's process; its waiting time begins now."""
        # A process that has not been started yet is not slow, so waiting begins with its start.
        self._queued.discard(member)
        self._starting[member] = now
        self._waits.pop(member, None)

    def arrived(self, member: str, now: float) -> bool:
        """Note the `hello` of a member; returns whether its process was known to start."""
        since = self._starting.pop(member, None)
        if since is None:
            return False
        # A machine that is slow for one start is slow for the others,
        # so their time-outs grow with it.
        self._slowest = max(self._slowest, now - since)
        self._waits.pop(member, None)  # The time of its start does not count for the frame.
        return True

    def overtaken(self, active: Collection[str], now: float) -> list[str]:
        """The members whose `hello` has overtaken the report of their start; they have arrived.

        `active` are those that take part in frames.
        """
        starts = self._starting.items()
        names = [name for name, at in starts if name in active and now >= at + MISSED_AFTER]
        for name in names:
            del self._starting[name]
            self._waits.pop(name, None)
        return names

    def update(self, step: object, in_frame: bool, waiting: Iterable[str], now: float) -> float:
        """Note which members a step waits for; returns the longest waiting time in seconds."""
        self._in_frame = in_frame
        # A new step has requests of its own, so earlier waiting does not count.
        if step != self._step:
            self._step, self._waits, self._reported = step, {}, {}
        names = sorted(set(waiting) - self._queued)
        self._waits = {
            name: self._waits.get(name) or _Wait(self._starting.get(name, now)) for name in names
        }
        return max((now - wait.since for wait in self._waits.values()), default=0.0)

    def patience(self, member: str) -> Patience:
        """The time-outs of a member in this step; a starting member gets those of a start."""
        own = self._deadlines.of(member)
        # A starting process gets the time-outs of a start, unless its own policy forbids restarts.
        joined = self._in_frame and member not in self._starting
        if joined or (self._in_frame and own.then != "restart"):
            return own
        return self._deadlines.with_start(self._slowest)

    def for_output(self, members: Iterable[str]) -> float:
        """Seconds that members have for their last output after the last frame."""
        return self._deadlines.for_output(members)

    def outlook(self, member: str, waited: float, guest: bool) -> str:
        """What follows for an awaited member, and when."""
        patience, deadlines = self.patience(member), self._deadlines
        left = duration(max(0.0, patience.hard - waited))
        action = THEN[patience.then]
        if patience.then in ("restart", "wait") and member in deadlines.elsewhere:
            return "it runs on another machine, and may return from there"
        if patience.then == "wait":
            return action
        if patience.then == "restart":
            if guest:
                return f"it will be removed in {left}; attach it again where it runs"
            action = FAILED[deadlines.on_failure.get(member, "restart")]
        return f"{action} in {left}"

    def since(self, member: str, now: float) -> float:
        """Seconds for which a member has been awaited; 0 if it is not."""
        return now - self._waits[member].since if member in self._waits else 0.0

    def reportable(self, now: float) -> list[str]:
        """The members to report now, with exponential back-off; they count as reported."""
        # Hundreds of members may start at the same time, and would be reported one by one.
        if not self._in_frame and now < self._last_report + STARTS_SAID_EVERY:
            return []
        names: list[str] = []
        for name, wait in self._waits.items():
            waited = now - wait.since
            if waited >= self.patience(name).soft and waited >= 4 * self._reported.get(name, 0.0):
                self._reported[name] = waited
                names.append(name)
        self._last_report = now if names else self._last_report
        return names

    def describe(
        self, names: Sequence[str], guests: Collection[str], now: float
    ) -> Iterator[tuple[str, str]]:
        """Members with the ends of their log lines; an empty name reports all of them together.

        `guests` are not processes of the world file, so nothing restarts them.
        """
        waited = {name: self.since(name, now) for name in names}
        if len(names) <= (MAX_NAMED if self._in_frame else 1):
            for name in names:
                yield name, f"it for {self._waited(name, waited[name], guests)}"
            return
        longest = max(names, key=lambda name: waited[name])
        shown = self._waited(longest, waited[longest], guests)
        yield "", f"{named_some(names, MAX_NAMED)} for {shown}"

    def _waited(self, name: str, waited: float, guests: Collection[str]) -> str:
        """How long a member has been awaited, and what follows."""
        return f"{waited:.1f} s; {self.outlook(name, waited, name in guests)}"

    def overdue(self, now: float) -> list[tuple[str, str]]:
        """Members after their time-out with the action to take, each once per step."""
        overdue: list[tuple[str, str]] = []
        for name, wait in self._waits.items():
            patience = self.patience(name)
            # Once per step: a restarted member gets a new wait, and a
            # skipped one is no longer awaited.
            late = now - wait.since >= patience.hard and not wait.done
            if late and patience.then != "wait":
                wait.done = True
                overdue.append((name, patience.then))
        return overdue

    def restart(self, member: str, now: float) -> None:
        """Restart the waiting time of a member."""
        self._waits[member] = _Wait(now)
