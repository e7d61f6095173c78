"""Periodic checks of a running world's members: status, time-outs, revoked certificates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from minerva_bus.frame import messages as m
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import Phase
from minerva_bus.frame.members import MemberState
from minerva_bus.runtime.waiting import MAX_NAMED, Waits
from minerva_bus.security.credentials import covers
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wording import duration, named_some

if TYPE_CHECKING:
    from minerva_bus.runtime.coordinator import Coordinator

STATUS_EVERY: Final = 0.1
"""Seconds between two reports of a world's status."""

GREETED_AGAIN: Final = 1.0
"""Seconds after which a member that has not answered its greeting is greeted once more."""

# Longer than the time after which such a member ends by itself (`member.BACK_WITHIN`).
BACK_WITHIN: Final = 6.0
"""Seconds that members of the previous coordinator have to return to its successor."""

# Shorter than the launcher waits before it kills the coordinator, which
# still has to send its final report.
HURRIED_REPORTS_WITHIN: Final = 0.5
"""Seconds for the last view and the report if a person or a failure ends the world."""


MORE_TIME: Final = "; hard = 120 under [process.NAME] gives a member more time"
"""The end of a log line about output that has been given up."""


class Monitor:
    """Checks every STATUS_EVERY seconds for awaited members, and acts on their time-outs."""

    def __init__(self, coordinator: Coordinator, waits: Waits) -> None:
        self._algorithm = coordinator.algorithm
        self._runner = coordinator.runner
        self._schedule = coordinator.schedule
        self._meter = coordinator.status
        self._admission = coordinator.admission
        self._log = coordinator.log
        self._watchers = coordinator.watchers
        self._clock = coordinator.system.monotonic
        self._waits = waits
        self._greeted: dict[str, float] = {}
        self._is_hurried = False

    def started(self, member: str) -> None:
        """Note that the launcher starts a member's process; its waiting time begins now."""
        self._waits.started(member, self._clock())

    def greeted(self, member: str) -> None:
        """Note that a greeting was sent to a member."""
        self._greeted[member] = self._clock()

    def arrived(self, member: str) -> None:
        """Note the `hello` of a member."""
        self._greeted.pop(member, None)
        if self._waits.arrived(member, self._clock()):
            self._watchers.came(member)

    def outlook(self, name: str) -> str:
        """What the world does with an awaited member, and when."""
        guest = not self._algorithm.members.get(name).expected
        return self._waits.outlook(name, self._waits.since(name, self._clock()), guest)

    def end(self, end: s.End) -> None:
        """End the world; members have less time for reports if its owner waits for the end."""
        if end.failed or end.hurried:
            self._is_hurried = True
        self._runner.handle(end)

    def tick(self, now: float) -> None:
        """Report the status and apply time-outs; `now` is the monotonic time in seconds."""
        self._schedule.check_end(now)
        if now < self._meter.at + STATUS_EVERY / 2:
            return  # After a long frame several ticks of the clock have queued up.
        # Revoked members are informed before the next check cuts their links.
        for name in self._admission.look(now):
            self._part_from(name)
        self._greet_again(now)
        self._log.report_omitted(now)
        algorithm = self._algorithm
        active = {member.name for member in algorithm.members.active()}
        for name in self._waits.overtaken(active, now):
            self._watchers.came(name)
        waiting = algorithm.waiting_for()
        step = algorithm.frame, algorithm.phase
        waited = self._waits.update(step, algorithm.in_frame, waiting, now)
        self._meter.waited = waited
        self._watchers.status(self._meter.status(now, waiting))
        if waited:
            self._report_waiting(waiting, now)

    def _part_from(self, common_name: str) -> None:
        """Remove all members that joined with a certificate that was revoked."""
        for member in self._algorithm.members:
            if covers(common_name, member.name) and member.state is not MemberState.LEFT:
                reason = self._admission.rules.shut_out(member.name)
                self._runner.handle(s.Violation(member.name, reason))

    def _greet_again(self, now: float) -> None:
        # After a link is restored, a member's token may arrive before its subscriptions do; the
        # first greeting is lost then.
        late = sorted(name for name, at in self._greeted.items() if now >= at + GREETED_AGAIN)
        for name in late:
            del self._greeted[name]
            # A guest that has left long ago is forgotten.
            known = self._algorithm.members.knows(name)
            if known and self._algorithm.members.get(name).state is MemberState.JOINING:
                # This notes the greeting again, so it is repeated until the member answers.
                self._runner.transport.send(name, m.Greet())

    def _report_waiting(self, waiting: Sequence[str], now: float) -> None:
        """Log which members the frame waits for, with back-off, and apply their time-outs."""
        algorithm = self._algorithm
        if algorithm.phase is Phase.STOPPING:
            # The second `Silent` drops members whose token is gone: a
            # token may overtake the last message.
            self._runner.handle(s.Silent())
            self._await_reports(now)
            return
        late = self._waits.reportable(now)
        if late:
            self._runner.handle(s.Silent())
            frame = f"frame {algorithm.frame} ({algorithm.phase.value}) has been waiting"
            guests = [name for name in late if not algorithm.members.get(name).expected]
            for name, text in self._waits.describe(late, guests, now):
                self._log.warn(name or COORDINATOR, f"{frame} for {text}")
        self._give_up_guests(waiting, now)
        for name, action in self._waits.overdue(now):
            self._time_out(name, action, now)

    def _await_reports(self, now: float) -> None:
        """Log which reports are missing after the last frame; after the time-out end without."""
        late = sorted(self._algorithm.waiting_for())
        within = HURRIED_REPORTS_WITHIN if self._is_hurried else self._waits.for_output(late)
        left = within - self._meter.waited
        waiting = f"the world has ended; waiting for {{}} for up to {duration(left)}"
        self._warn_of(self._waits.reportable(now), waiting, "its last output", "the last output")
        if left > 0:
            return
        for name in late:
            self._watchers.stalled(name, self._meter.waited)
        missing = (
            f"after the last frame, {{}} did not come within {within:g} s and may be missing"
            f"{'' if self._is_hurried else MORE_TIME}"
        )
        self._warn_of(late, missing, "its output", "the output")
        self._runner.handle(s.End("no report in time"))

    def _warn_of(self, names: Sequence[str], text: str, its: str, the: str) -> None:
        """Log a text for each of a few members, or once for all of many."""
        if len(names) > MAX_NAMED:
            self._log.warn(COORDINATOR, text.format(f"{the} of {named_some(names, MAX_NAMED)}"))
            return
        for name in names:
            self._log.warn(name, text.format(its))

    def _time_out(self, name: str, action: str, now: float) -> None:
        """Apply the time-out policy of a member: skip, stop or restart."""
        waited = self._waits.since(name, now)
        if action == "skip":
            self._runner.handle(s.Skip(name))
        elif action == "stop":
            silence = f"did not answer for {waited:.1f} s in frame {self._algorithm.frame}"
            self._log.warn(name, f"{silence}; the world stops")
            self.end(s.End(f"{name} {silence}", failed=True))
        else:
            # The next process gets the full time, regardless of the previous one.
            self._waits.restart(name, now)
            self._watchers.stalled(name, waited)
            # Nothing restarts a guest, so it is excluded; it may join again.
            if not self._algorithm.members.get(name).expected:
                reason = f"it did not answer for {duration(waited)}"
                self._runner.handle(s.Violation(name, reason))

    def _give_up_guests(self, waiting: Sequence[str], now: float) -> None:
        """Stop waiting for members of the previous coordinator that have not returned."""
        # The journal names guests of the predecessor, but some may have left with it.
        for name in self._algorithm.members.missing_guests():
            if name in waiting and self._waits.since(name, now) >= BACK_WITHIN:
                self._runner.handle(s.Abandoned(name))
