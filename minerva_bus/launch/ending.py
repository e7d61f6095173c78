"""The end of a world: why, until when its processes may run, and the summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from minerva_bus.frame.description import World
from minerva_bus.launch.summary import EndReport, RunSummary, Startup


@dataclass(slots=True)
class Ending:
    """The end of the world; at the `deadline` its remaining processes are killed.

    `problem`: the reason for a premature end, followed by the lines of user code that caused it if
    they are known. `reason`: that of the coordinator, None before it stops, which is at
    `stopping_at`. `report`: its last report. `followed`: another
    launcher's coordinator runs the world. Times are of the monotonic clock.
    """

    problem: str = ""
    reason: str | None = None
    report: EndReport | None = None
    deadline: float | None = None
    stopping_at: float | None = None
    interrupts: int = 0
    followed: bool = False

    @property
    def failure(self) -> str:
        """The reason for a premature end in one line."""
        return self.problem.partition("\n")[0]

    @property
    def begun(self) -> bool:
        """Whether the world stops or has ended."""
        return self.reason is not None or self.deadline is not None

    @property
    def regular(self) -> bool:
        """Whether nothing has failed and nobody has interrupted the world."""
        failed = self.report is not None and self.report.failed
        return not (self.failure or self.interrupts or failed)

    def fail(self, problem: str) -> None:
        """Note a failure. The first one is the cause; later ones may be its consequences."""
        self.problem = self.problem or problem

    def end_by(self, deadline: float) -> None:
        """Set a deadline, unless an earlier one is set."""
        self.deadline = deadline if self.deadline is None else min(self.deadline, deadline)

    def summary(
        self, world: World, startup: Startup, frame: int, now: float, joined: Sequence[bool]
    ) -> RunSummary:
        """The summary of the run; digest and figures are lost if the coordinator died.

        `joined`: whether each member has joined; with `frame` and `now`, it replaces the report
        of a coordinator that died.
        """
        report = self.report
        if report is None:
            self.fail("the coordinator ended without a report")
            report = EndReport(self.failure, frame, now, sum(joined))
        elif report.failed:
            self.fail(report.reason)
        return RunSummary.of(world, report, startup, self.failure)
