"""The log of a running world: lines that members print, warnings about them, recent events.

A member can fail, or join and leave, ten thousand times a second. Log, terminal and record must
remain readable, and still name the member, so the lines about each are limited and those that were
omitted are counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from minerva_bus.frame import stimuli as s
from minerva_bus.frame.collection import ORDERS
from minerva_bus.frame.event_log import EventLog
from minerva_bus.frame.orders import OrderFates
from minerva_bus.frame.world_state import WorldProgress
from minerva_bus.runtime.metrics import Metrics
from minerva_bus.runtime.runner import Sink
from minerva_bus.runtime.session import System
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.plain import on_screen
from minerva_bus.wording import counted
from minerva_bus.world.operator import PersonOperation

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
        """Note that an order of a person counts, or which norm rejects it."""
        self.orders.judge(notice.event, notice.person, notice.frame, notice.norm)

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
