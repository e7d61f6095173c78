"""What a coordinator observes of its frames: metrics, the status, and the log of its world.

`minerva run --profile`, `minerva top` and Prometheus show the metrics. The clock is read only while
an operator requests them, because reading it several times for each message would slow down every
frame of a large world. Totals of the measured frames only increase, as Prometheus requires.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from time import perf_counter
from typing import Any, Final, ParamSpec, TypeVar

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import ORDERS
from minerva_bus.frame.pace import Pace
from minerva_bus.frame.world_state import Phase, WorldProgress
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.runtime.order_fates import OrderFates
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.session import System
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.plain import on_screen
from minerva_bus.wording import counted
from minerva_bus.world.operator import LogEntry, LogLine, PersonOperation

BOUNDS: Final = (
    0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5,
    10.0,
)  # fmt: skip
"""Upper bounds of the histogram buckets, in seconds."""

_BYTES: Final = ("bytes in", "bytes out")
_MICRO: Final = 1e-6


@dataclass(slots=True)
class Durations:
    """Histogram of durations: a count for each of BOUNDS and one beyond, and their sum in s."""

    counts: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS) + 1))
    seconds: float = 0.0

    def add(self, seconds: float) -> None:
        """Count one duration."""
        # Bounds are inclusive, as in Prometheus.
        self.counts[bisect_left(BOUNDS, seconds)] += 1
        self.seconds += seconds


@dataclass(slots=True)
class Totals:
    """Frames, their parts' durations, events by type, and bytes from and to members."""

    frames: int = 0
    phases: dict[str, Durations] = field(default_factory=dict[str, Durations])
    events: dict[str, int] = field(default_factory=dict[str, int])
    bytes_in: int = 0
    bytes_out: int = 0

    def add(self, sums: Mapping[str, float]) -> None:
        """Count one frame's sums: microseconds by part, and bytes.

        Waiting times of single members are omitted: a histogram for each member would be too much.
        """
        self.frames += 1
        self.bytes_in += int(sums.get("bytes in", 0))
        self.bytes_out += int(sums.get("bytes out", 0))
        for name, amount in sums.items():
            if name not in _BYTES and not name.startswith("wait for "):
                self.phases.setdefault(name, Durations()).add(_MICRO * amount)

    def count(self, events: Iterable[AnyEvent]) -> None:
        """Count one frame's events."""
        for event in events:
            self.events[event.type] = self.events.get(event.type, 0) + len(event)

    def plain(self) -> dict[str, Any]:
        """The totals as plain data."""
        return {
            "frames": self.frames,
            "phases": {name: [d.counts, d.seconds] for name, d in sorted(self.phases.items())},
            "events": dict(sorted(self.events.items())),
            "bytes": [self.bytes_in, self.bytes_out],
        }


MICRO: Final = 1e6
RECENT_FRAMES: Final = 64
MEASURED_SECONDS: Final = 5.0
"""Seconds that metrics are measured after the last question for them."""

Figures = dict[str, float]
P = ParamSpec("P")
Result = TypeVar("Result")


class FrameFigures:
    """Amounts by name: sums within a frame, one number per frame after it.

    `keep` stores the numbers of all frames for a profile.
    """

    def __init__(self, keep: bool) -> None:
        self.totals = Totals()
        self._keep = keep
        self._sums: dict[str, float] = {}
        self._frames: dict[str, array[float]] = {}
        self._recent: deque[dict[str, float]] = deque(maxlen=RECENT_FRAMES)

    def add(self, name: str, amount: float) -> None:
        """Add an amount to the current frame."""
        self._sums[name] = self._sums.get(name, 0.0) + amount

    def close(self) -> None:
        """End the current frame."""
        sums, self._sums = self._sums, {}
        self._recent.append(sums)
        self.totals.add(sums)
        for name, amount in sums.items() if self._keep else ():
            self._frames.setdefault(name, array("d")).append(amount)

    def recent(self) -> dict[str, float]:
        """Means over the last frames; a frame without an amount counts as 0."""
        total: dict[str, float] = {}
        for sums in self._recent:
            for name, amount in sums.items():
                total[name] = total.get(name, 0.0) + amount
        return {name: total[name] / len(self._recent) for name in sorted(total)}

    def clear(self) -> None:
        """Drop the last frames, because the next measured frame may be much later."""
        self._sums.clear()
        self._recent.clear()

    def plain(self) -> dict[str, Figures]:
        """Mean, median and 99th percentile over the frames with this amount, greatest first."""
        figures = {name: _figures(amounts) for name, amounts in self._frames.items()}
        return dict(sorted(figures.items(), key=lambda item: (-item[1]["mean"], item[0])))


def _figures(amounts: array[float]) -> Figures:
    ordered = sorted(amounts)
    return {
        "mean": round(sum(ordered) / len(ordered), 1),
        "p50": round(ordered[len(ordered) // 2], 1),
        "p99": round(ordered[min(len(ordered) - 1, len(ordered) * 99 // 100)], 1),
        "frames": len(ordered),
    }


class Metrics(Sink):
    """Measures the frames of one algorithm, in microseconds and bytes.

    tick, evolve   from the request to the last reply
    wait for NAME  from a request to this member's reply, both requests together; absent if the
                   reply had arrived before the frame began
    collect        after the last reply to a tick: steps 2 to 4
    commit         end of a frame: changes to w, digest, next requests
    encode, view   messages to bytes; of these, views including their publication
    decode         replies from bytes, except empty ones, which are compared only
    frame          from one end of a frame to the next, including waiting

    With `keep` every frame is measured, otherwise those within MEASURED_SECONDS of a question.
    `clock` gives monotonic seconds. `on` is whether frames are measured now, `wanted` whether
    an operator asked for metrics within MEASURED_SECONDS before the last frame.
    """

    def __init__(
        self, algorithm: WorldProgress, clock: Callable[[], float], keep: bool = False
    ) -> None:
        self.on = self.follows = self._keep = keep
        self.wanted = False
        self._figures = FrameFigures(keep)
        self._algorithm = algorithm
        self._clock = clock
        self._wanted_until = 0.0
        self._asked_at = self._ended_at = perf_counter()
        self._phase, self._began = algorithm.phase, 0.0
        self._done = False

    # --- questions ---

    def profile(self) -> Mapping[str, Figures]:
        """Statistics of all frames, with `keep`."""
        return self._figures.plain()

    def measured(self) -> Mapping[str, float]:
        """Means over the last frames; the next frames are measured too."""
        self._want()
        return self._figures.recent()

    def counted(self) -> Totals:
        """Totals of the measured frames; the next frames are measured too."""
        self._want()
        return self._figures.totals

    def _want(self) -> None:
        self.wanted, self._wanted_until = True, self._clock() + MEASURED_SECONDS
        if not self.on:
            self._asked_at = self._ended_at = perf_counter()
            self._switch(on=True)

    def _switch(self, *, on: bool) -> None:
        # While nothing is measured, the runner does not even call this sink for each stimulus.
        self.on = self.follows = on
        self.runner.refresh()

    # --- measuring ---

    def add(self, name: str, amount: float) -> None:
        """Add an amount to the current frame, while frames are measured."""
        if self.on:
            self._figures.add(name, amount)

    def timed(
        self, name: str, call: Callable[P, Result], *args: P.args, **options: P.kwargs
    ) -> Result:
        """Call a function and add its duration."""
        if not self.on:
            return call(*args, **options)
        began = perf_counter()
        try:
            return call(*args, **options)
        finally:
            self._figures.add(name, MICRO * (perf_counter() - began))

    def received(self, stimulus: s.Stimulus) -> None:
        """Measure the waiting time for a reply."""
        self._phase, self._began = self._algorithm.phase, perf_counter()
        replies = isinstance(stimulus, m.TickReply | m.EvolveReply)
        # A reply that arrived early, or late, was not awaited in this frame.
        if replies and stimulus.frame == self._algorithm.frame:
            waited = MICRO * (self._began - self._asked_at)
            self._figures.add(f"wait for {stimulus.member}", waited)

    def decided(self, stimulus: s.Stimulus, instructions: Sequence[s.Instruction]) -> None:
        """Measure a step of the frame that this stimulus completed."""
        ended = perf_counter()
        self._done = any(isinstance(instruction, s.FrameDone) for instruction in instructions)
        if not self._done and self._algorithm.phase is self._phase:
            return
        if self._phase in (Phase.TICK, Phase.EVOLVE):
            name = "tick" if self._phase is Phase.TICK else "evolve"
            self._figures.add(name, MICRO * (self._began - self._asked_at))
        if self._done or self._phase is Phase.TICK:
            name = "commit" if self._done else "collect"
            self._figures.add(name, MICRO * (ended - self._began))

    def executed(self, stimulus: s.Stimulus) -> None:
        """Begin to wait for replies, or end the frame."""
        if self._done:
            self._done, now = False, perf_counter()
            self._figures.add("frame", MICRO * (now - self._ended_at))
            self._ended_at = now
            self._figures.close()
        elif self._algorithm.phase is not self._phase:
            self._asked_at = perf_counter()

    def stopping(self, notice: s.Stopping) -> None:
        """Count the last events of the world."""
        if self.on:
            self._figures.totals.count(notice.events)

    def frame_done(self, notice: s.FrameDone) -> None:
        """Count the events of a frame; stop measuring some time after the last question."""
        if not self.on:
            return
        self._figures.totals.count(notice.events)
        if self.wanted and self._clock() >= self._wanted_until:
            self.wanted = False
            if not self._keep:
                self._switch(on=False)
                # Means over frames from before the pause would be misleading.
                self._figures.clear()


# --- the status of a world ---

SMOOTHING: Final = 0.3
"""Weight of the last interval in the frame rate."""


@dataclass(frozen=True, slots=True)
class Status:
    """State of a running world; `rate` is in frames per second, `waited` in seconds."""

    frame: int
    rate: float
    members: int
    phase: str
    paused: bool = False
    waiting: tuple[str, ...] = ()
    waited: float = 0.0


class StatusMeter(Sink):
    """Frame rate and number of members. `waited` is the waiting time of the current step."""

    def __init__(self, algorithm: WorldProgress, pace: Pace, now: float) -> None:
        self.hz = 0.0
        self.waited = 0.0
        self.most_members = 0
        self.at = now
        self._frame: int = 0
        self._algorithm = algorithm
        self._pace = pace

    def status(self, now: float, waiting: Sequence[str]) -> Status:
        """The status at a monotonic time; the rate is that since the last one."""
        algorithm, paused = self._algorithm, self._pace.paused
        rate = (algorithm.frame - self._frame) / max(now - self.at, 1e-9)
        # A paused world has no frames, which an average would show only after a while.
        self.hz = rate if paused else self.hz + SMOOTHING * (rate - self.hz)
        self.at, self._frame = now, algorithm.frame
        active = len(algorithm.members.active())
        self.most_members = max(self.most_members, active)
        phase = algorithm.phase.value
        return Status(algorithm.frame, rate, active, phase, paused, tuple(waiting), self.waited)

    def ready(self, notice: s.Ready) -> None:
        """Count the members at the beginning of the world."""
        if notice.frame == 0:
            self.most_members = len(self._algorithm.members.active())


# --- the log: lines that members print, warnings about them, recent events ---

AT_ONCE: Final = 20
"""Lines about one subject that are logged at once; after that, one per second."""

GUESTS: Final = "members from elsewhere"
"""The common subject of all members that are not processes of the world file."""

MAX_SUBJECTS: Final = 1000


@dataclass(slots=True)
class _Subject:
    room: float
    at: float
    held: int = 0


class Restraint:
    """A token bucket of log lines for each subject; `now` is in seconds."""

    def __init__(self) -> None:
        self._subjects: dict[str, _Subject] = {}

    def lets(self, subject: str, now: float) -> bool:
        """Whether a line may be logged; omitted lines are counted."""
        known = self._subjects.get(subject)
        if known is None:
            # Names may be invented, so the table must not grow without limit.
            if len(self._subjects) >= MAX_SUBJECTS:
                self._forget(now)
            known = self._subjects.setdefault(subject, _Subject(AT_ONCE, now))
        known.room = min(AT_ONCE, known.room + now - known.at)
        known.at = now
        # A line after omitted ones waits as well, until `left_out` has reported their number.
        if known.room < 1.0 or known.held:
            known.held += 1
            return False
        known.room -= 1.0
        return True

    def left_out(self, now: float) -> Iterator[tuple[str, str]]:
        """The subjects that may be logged again, with the number of omitted lines in words."""
        for name, known in self._subjects.items():
            room = known.room + now - known.at
            if known.held and room >= 1.0:
                known.room, known.at = room - 1.0, now
                whom = GUESTS if name == GUESTS else "it"
                yield name, f"{counted(known.held, 'more line')} about {whom} omitted"
                known.held = 0

    def _forget(self, now: float) -> None:
        """Forget the subjects with a full bucket and no omitted lines."""
        self._subjects = {
            name: known
            for name, known in self._subjects.items()
            if known.held or known.room + now - known.at < AT_ONCE
        }


class WorldLog(Sink):
    """Keeps the last lines and events, and passes warnings to `show` (member, text, details).

    Warnings about one member are rate-limited: members may err thousands of times a second, and the
    log, the terminal and the record must remain readable.
    """

    def __init__(
        self,
        algorithm: WorldProgress,
        show: Callable[[str, str, str], None],
        system: System,
        metrics: Metrics,
    ) -> None:
        self.event_log = EventLog()
        self.orders = OrderFates(algorithm.world.vocabulary, algorithm.world.order)
        self._algorithm = algorithm
        self._metrics = metrics
        self._show = show
        self._system = system
        self._restraint = Restraint()

    def line(self, member: str, text: str, level: str) -> None:
        """Keep a line that a member printed."""
        self.event_log.line(self._system.time(), member, text, self._algorithm.frame, level)

    def warn(self, member: str, text: str, details: str = "") -> None:
        """Log and show a warning about a member; `details` are for the log only."""
        members = self._algorithm.members
        guest = members.knows(member) and not members.get(member).expected
        # Guests share one bucket, because they may join under any number of names.
        if self._restraint.lets(GUESTS if guest else member, self._system.monotonic()):
            self._write(member, text, details)

    def report_omitted(self, now: float) -> None:
        """Log the number of omitted warnings for each member that may be logged again."""
        for subject, text in self._restraint.left_out(now):
            self._write(COORDINATOR if subject == GUESTS else subject, text)

    def notify(self, notice: s.Notify) -> None:
        """Log a report of the algorithm."""
        self.warn(notice.member, notice.text, notice.details)

    def order_judged(self, notice: s.OrderJudged) -> None:
        """Note that an order of a person counts, or why it does not."""
        self.orders.judge(notice.event, notice.person, notice.frame, notice.state, notice.by)

    def operated(self, operation: PersonOperation) -> None:
        """Keep an operation of a person, beside the orders."""
        # A program that steps a world has no name; its steps would be most lines.
        if operation.person or operation.command not in ("pause", "step"):
            self.line(ORDERS, str(operation), "info")

    def frame_done(self, notice: s.FrameDone) -> None:
        """Log which orders have ended; a frame's events while an operator watches."""
        for order in self.orders.end_frame(notice.frame, notice.events):
            self.warn(ORDERS, f"{order.event} of {order.person or 'people'}: {order.fate}")
        if self._metrics.wanted:
            self.event_log.frame(notice.frame, notice.events)

    def stopping(self, notice: s.Stopping) -> None:
        """Log the last events of the world, as those of a frame."""
        if self._metrics.wanted:
            self.event_log.frame(notice.frame, notice.events)

    def _write(self, member: str, text: str, details: str = "") -> None:
        # A member's text must not control the terminal of the person who reads it.
        text, details = on_screen(text), on_screen(details)
        self.line(member, f"{text}\n{details}" if details else text, "warning")
        self._show(member, text, details)


EVENT_FRAMES: Final = 64
"""Frames over which the rate of events is averaged."""

MAX_ENTRIES: Final = 1000
MAX_LINES: Final = 4000
MAX_LINE_LENGTH: Final = 2000
MAX_ENTRY_LENGTH: Final = 300
MAX_REPLY: Final = 200
"""Entries in one reply to a reader."""

MAX_PER_TYPE: Final = 2
"""Maximum events of one type that are logged singly in a frame; further ones are counted."""


class EventLog:
    """The events of the last frames and the last log lines; older ones are dropped."""

    def __init__(self) -> None:
        self._counts: deque[Counter[str]] = deque(maxlen=EVENT_FRAMES)
        self._entries: deque[LogEntry] = deque(maxlen=MAX_ENTRIES)
        self._lines: deque[LogLine] = deque(maxlen=MAX_LINES)
        self._last_entry: int = 0
        self._last_line: int = 0

    def frame(self, number: int, events: Iterable[AnyEvent]) -> None:
        """Log a frame's events, in their order."""
        counts: Counter[str] = Counter()
        for batch in events:
            room = MAX_PER_TYPE - counts[batch.type]
            counts[batch.type] += len(batch)
            # Iterating over a batch makes an event for each row, so only
            # the rows that are logged are read.
            for event in islice(batch, max(0, room)):
                self._add(number, event.type, _short(str(event), MAX_ENTRY_LENGTH))
        for event_type, count in sorted(counts.items()):
            if count > MAX_PER_TYPE:
                self._add(number, event_type, f"{event_type}: {count} of them in this frame")
        self._counts.append(counts)

    def line(
        self, time: float, member: str, text: str, frame: int = 0, level: str = "info"
    ) -> None:
        """Log a line of a member or about it; `time` is in seconds since 1970."""
        for line in text.rstrip("\n").split("\n"):
            self._last_line += 1
            self._lines.append(LogLine(self._last_line, time, member, _short(line), frame, level))

    def per_frame(self) -> dict[str, float]:
        """Average number of events per frame, by type, over the last frames."""
        total: Counter[str] = Counter()
        for counts in self._counts:
            total.update(counts)
        return {event_type: total[event_type] / len(self._counts) for event_type in sorted(total)}

    def entries(self, since: int) -> tuple[LogEntry, ...]:
        """The latest entries after the entry of this number."""
        entries = [entry for entry in self._entries if entry.number > since]
        return tuple(entries[-MAX_REPLY:])

    def lines(self, since: int, member: str = "") -> tuple[LogLine, ...]:
        """The log lines after the line of this number, of one member or of all."""
        return tuple(
            [line for line in self._lines if line.number > since and member in ("", line.member)]
        )

    def _add(self, frame: int, about: str, text: str) -> None:
        self._last_entry += 1
        self._entries.append(LogEntry(self._last_entry, frame, about, text))


def _short(text: str, longest: int = MAX_LINE_LENGTH) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"
