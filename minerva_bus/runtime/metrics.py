"""What a coordinator observes of its frames: metrics, status, log, and the fates of orders.

`minerva run --profile`, `minerva top` and Prometheus show the metrics. The clock is read only while
an operator requests them, because reading it several times for each message would slow down every
frame of a large world. Totals of the measured frames only increase, as Prometheus requires.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any, Final, ParamSpec, TypeVar

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection_step import ORDERS
from minerva_bus.frame.world_state import Phase, WorldProgress
from minerva_bus.grammar.events import AnyEvent, Event, Events, single
from minerva_bus.grammar.text_and_digest import same_values
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.runtime.pace import Pace
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.session import System
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.plain import on_screen
from minerva_bus.wording import counted
from minerva_bus.world.event_collection import Priority
from minerva_bus.world.operator import LogEntry, LogLine, OrderStatus, PersonOperation

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

        Amounts of single members are omitted: a histogram for each member would be too much.
        """
        self.frames += 1
        self.bytes_in += int(sums.get("bytes in", 0))
        self.bytes_out += int(sums.get("bytes out", 0))
        for name, amount in sums.items():
            if name not in _BYTES and not name.startswith(("wait for ", "bytes of ")):
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
        self._done: s.FrameDone | None = None

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
        replies = isinstance(stimulus, (m.TickReply, m.EvolveReply))
        # A reply that arrived early, or late, was not awaited in this frame.
        if replies and stimulus.frame == self._algorithm.frame:
            waited = MICRO * (self._began - self._asked_at)
            self._figures.add(f"wait for {stimulus.member}", waited)

    def decided(self, stimulus: s.Stimulus, instructions: Sequence[s.Instruction]) -> None:
        """Measure a step of the frame that this stimulus completed."""
        ended = perf_counter()
        self._done = next((each for each in instructions if isinstance(each, s.FrameDone)), None)
        if self._done is None and self._algorithm.phase is self._phase:
            return
        if self._phase in (Phase.TICK, Phase.EVOLVE):
            name = "tick" if self._phase is Phase.TICK else "evolve"
            self._figures.add(name, MICRO * (self._began - self._asked_at))
        if self._done is not None or self._phase is Phase.TICK:
            name = "collect" if self._done is None else "commit"
            self._figures.add(name, MICRO * (ended - self._began))

    def executed(self, stimulus: s.Stimulus) -> None:
        """Begin to wait for replies, or end the frame."""
        if self._done is not None:
            self._end_frame(self._done)
        elif self._algorithm.phase is not self._phase:
            self._asked_at = perf_counter()

    def stopping(self, notice: s.Stopping) -> None:
        """Count the last events of the world."""
        if self.on:
            self._figures.totals.count(notice.events)

    def _end_frame(self, done: s.FrameDone) -> None:
        """Count the events of a frame; stop measuring some time after the last question."""
        self._done, now = None, perf_counter()
        self._figures.add("frame", MICRO * (now - self._ended_at))
        self._ended_at = now
        self._figures.totals.count(done.events)
        self._figures.close()
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
        active = len(algorithm.members.index.active)
        self.most_members = max(self.most_members, active)
        phase = algorithm.phase.value
        return Status(algorithm.frame, rate, active, phase, paused, tuple(waiting), self.waited)

    def stopping(self, notice: s.Stopping) -> None:
        """Count the members of a world that ends before its first status."""
        self.most_members = max(self.most_members, len(self._algorithm.members.index.active))


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
            room = max(0, MAX_PER_TYPE - counts[batch.type])
            counts[batch.type] += len(batch)
            # The first event of a batch would make the texts of all of its ids.
            logged = batch.take(slice(room)) if isinstance(batch, Events) else [batch][:room]
            for event in logged:
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


# --- what becomes of the orders of people ---

MAX_ORDERS: Final = 1000
"""Orders whose fates are kept; older ones are dropped."""

_BY_NAME: Final = Priority()


@dataclass(slots=True)
class _Order:
    event: Event
    status: OrderStatus
    able: int = 0
    """Number of agents that it is for; 0: unknown."""
    accepted: int = -1
    """The frame that it counts in."""
    failed: set[str] = field(default_factory=set[str])
    """The agents that have failed it."""


class OrderFates:
    """The last orders of people, with their fates.

    An order waits until a frame takes it: then it is accepted, or a norm rejects it. It is dropped
    if the frame ends a host twice, and is repeated without the events of people. An event type
    may declare that it `completes` or `fails` orders of some types. Such an event of an agent
    concerns the last order of these types that was accepted before, that is addressed to this agent
    or to all, and whose data are equal to those of the event where both have data of one name; and
    all orders equal to it, because people may give the same order. An order to all has failed when
    all agents that respond to its type have failed it: until then, another may still complete it.

    An event type may also declare that such an order `replaces` orders of some types: those that
    were before it, that have not ended, whose receivers all receive it, and that are not equal.

    Args:
        vocabulary: the declarations of event types.
        order: the order of the events of one frame.

    """

    def __init__(self, vocabulary: Vocabulary, order: Priority = _BY_NAME) -> None:
        self._order = order
        self._completes = {e.name: e.completes for e in vocabulary.events.values() if e.completes}
        self._fails = {e.name: e.fails for e in vocabulary.events.values() if e.fails}
        self._replaces = {e.name: e.replaces for e in vocabulary.events.values() if e.replaces}
        ends = (*self._completes.values(), *self._fails.values(), *self._replaces.values())
        self._ended = frozenset[str]().union(*ends)
        self._orders: dict[int, _Order] = {}
        self._open: set[int] = set()
        self._waiting: set[int] = set()
        self._accepted: list[int] = []
        """The orders that this frame has accepted."""
        self._last_number = 0
        self._last_change = 0

    def arrive(self, event: Event, person: str, frame: int, able: int = 0) -> int:
        """Note an order that waits for a frame; returns its number.

        `able`: the number of agents that it is for, 0 if that is not known.
        """
        self._last_number += 1
        number = self._last_number
        status = OrderStatus(
            number, self._next_change(), person, str(event), event.type, "waiting", frame
        )
        self._orders[number] = _Order(event, status, able)
        self._waiting.add(number)
        if len(self._orders) > MAX_ORDERS:
            oldest = next(iter(self._orders))
            del self._orders[oldest]
            self._open.discard(oldest)
            self._waiting.discard(oldest)
        return number

    def judge(
        self, event: Event, person: str, frame: int, state: str = "accepted", by: str = ""
    ) -> None:
        """Note that a frame accepts an order, a norm rejects it, or the frame drops it again."""
        judged = (
            number
            for number in (self._accepted if state == "dropped" else sorted(self._waiting))
            if (order := self._orders.get(number)) is not None
            and order.status.person == person
            and order.event == event
        )
        number = next(judged, None)
        if number is None:  # It arrived at an earlier coordinator of this world.
            number = self.arrive(event, person, frame)
        self._waiting.discard(number)
        self._orders[number].accepted = frame
        # Open even if no agent reports about it: its frame may still drop it.
        self._change(number, state, frame, by, is_open=state == "accepted")
        if state == "accepted":
            self._accepted.append(number)
        elif state == "dropped" and number in self._accepted:
            self._accepted.remove(number)

    def end_frame(self, frame: int, events: Iterable[AnyEvent]) -> list[OrderStatus]:
        """Note what the accepted orders and the events of a frame end; returns these orders."""
        for number in self._accepted:
            order = self._orders.get(number)
            if order is not None and order.event.type not in self._ended:
                self._change(number, "accepted", frame, "", is_open=False)
        changed = self._replace(frame) if self._accepted else []
        if self._open:
            changed += self._report(frame, events)
        return changed

    def _replace(self, frame: int) -> list[OrderStatus]:
        """Note which orders those that were accepted in a frame replace."""
        # As agents receive them, whereas they were judged person by person.
        accepted = sorted(self._accepted, key=self._place)
        self._accepted.clear()
        changed: list[OrderStatus] = []
        for position, number in enumerate(accepted):
            by = self._orders.get(number)
            if by is None or by.event.type not in self._replaces:
                continue
            later = accepted[position:]
            for other in sorted(self._open.difference(later)):
                if self._is_replaced(self._orders[other].event, by.event):
                    text = by.status.event
                    changed.append(self._change(other, "replaced", frame, text, is_open=False))
        return changed

    def _place(self, number: int) -> tuple[int, str, str, int]:
        order = self._orders.get(number)
        if order is None:  # A later order has displaced it.
            return 0, "", "", number
        return self._order.key(order.event.type, order.status.person, number)

    def _is_replaced(self, event: Event, by: Event) -> bool:
        return (
            event.type in self._replaces[by.type]
            and event != by
            and not by.condition
            and (not by.receivers or set() < set(event.receivers) <= set(by.receivers))
        )

    def _report(self, frame: int, events: Iterable[AnyEvent]) -> list[OrderStatus]:
        """Note the reports among the events of a frame."""
        changed: list[OrderStatus] = []
        reports = self._completes.keys() | self._fails.keys()
        for event in single(each for each in events if each.type in reports):
            sender = event.sender
            for number in self._matches(event, self._completes.get(event.type, ()), frame):
                changed.append(self._change(number, "done", frame, sender, is_open=False))
            for number in self._matches(event, self._fails.get(event.type, ()), frame):
                order, text = self._orders[number], str(event)
                order.failed.add(sender)
                rest = not order.event.receivers and len(order.failed) != order.able
                changed.append(
                    self._change(number, "failed", frame, sender, is_open=rest, report=text)
                )
        return changed

    def changed_since(self, change: int) -> tuple[OrderStatus, ...]:
        """The orders that have changed after the change of this number, oldest change first."""
        statuses = [order.status for order in self._orders.values()]
        changed = [status for status in statuses if status.change > change]
        return tuple(sorted(changed, key=lambda status: status.change))

    def _matches(self, report: Event, types: tuple[str, ...], frame: int) -> list[int]:
        """The open orders that an agent's report concerns."""
        if not report.sender:  # What a person or a generator sends is not a report of an agent.
            return []
        concerned = [n for n in sorted(self._open) if self._concerns(report, types, n, frame)]
        last = self._orders[concerned[-1]].event if concerned else None
        return [n for n in concerned if self._orders[n].event == last]

    def _concerns(self, report: Event, types: tuple[str, ...], number: int, frame: int) -> bool:
        order, data = self._orders[number].event, report.data
        return (
            order.type in types
            and self._orders[number].accepted < frame
            and report.sender in (order.receivers or (report.sender,))
            and all(
                same_values((data[name],), (value,))
                for name, value in order.data.items()
                if name in data
            )
        )

    def _change(
        self, number: int, state: str, frame: int, by: str, *, is_open: bool, report: str = ""
    ) -> OrderStatus:
        order, change = self._orders[number], self._next_change()
        order.status = replace(
            order.status, state=state, frame=frame, by=by, change=change, open=is_open,
            report=report,
        )  # fmt: skip
        if is_open:
            self._open.add(number)
        else:
            self._open.discard(number)
        return order.status

    def _next_change(self) -> int:
        self._last_change += 1
        return self._last_change
