"""Ends of a world's processes: restarts, successors of the coordinator, and the world's end."""

from __future__ import annotations

from typing import Final

from minerva_bus.launch.coordinator_reports import CoordinatorReports
from minerva_bus.launch.forking import FAILED, UNREADY, how_ended
from minerva_bus.launch.process_log import FAILURE_REPORT
from minerva_bus.launch.process_table import REPORT_SECONDS, SupervisedProcess
from minerva_bus.launch.succession import MAX_SUCCESSIONS
from minerva_bus.launch.supervised_run import SupervisedRun
from minerva_bus.launch.traces import STACK_SIGNAL
from minerva_bus.runtime.member import RAISED, RAISED_BY_CHANCE
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wording import duration

CANNOT_TAKE_PART: Final = "cannot take part"
"""What is logged about a process that this world does not suit; its report has the reason."""


class ProcessExits:
    """Decides what follows the end of a process."""

    def __init__(self, run: SupervisedRun, reports: CoordinatorReports) -> None:
        self._run = run
        self._reports = reports

    def reap(self) -> None:
        """Handle the ends of all processes that have ended."""
        while (ended := self._run.machine.next_ended()) is not None:
            self.ended(*ended)

    def ended(self, pid: int, code: int) -> None:
        """Handle the end of a process."""
        run = self._run
        if run.coordinator.child is not None and pid == run.coordinator.child.pid:
            self._on_coordinator_exit(code)
            return
        process = run.processes.ended(pid)
        if process is None:
            return
        if run.ending.begun:
            if code == UNREADY:  # Its report says why.
                run.ending.fail(f"{_member(process)} {process.cause.text or CANNOT_TAKE_PART}")
            # A successor must not wait for it; the first coordinator was notified that it left.
            if run.coordinator.count:
                run.abandon(process)
        elif process.restarting:
            process.restarting, process.restart_at = False, run.machine.monotonic()
        elif code == 0:
            process.exited()
        else:
            self.failed(process, code)

    def _on_coordinator_exit(self, code: int) -> None:
        run = self._run
        coordinator, ending = run.coordinator, run.ending
        coordinator.ended()
        if ending.report is not None:
            return  # The deadline of its members is set.
        if ending.deadline is None and coordinator.may_continue(code):
            ended = f"failed ({self._reports.last_line})" if code == FAILED else how_ended(code)
            text = f"{ended}; a successor continues from its journal"
            number = f"({coordinator.count + 1} of {MAX_SUCCESSIONS})"
            run.console.log(COORDINATOR, f"{text} {number}", "warning")
            coordinator.start_successor(run.processes.queued)
            return
        # It printed its error last, if it had one.
        ending.fail(self._reports.last_line or f"the coordinator {how_ended(code)}")
        # The report that would set the deadline no longer arrives.
        ending.end_by(run.machine.monotonic() + run.report_seconds)

    def failed(self, process: SupervisedProcess, code: int) -> None:
        """Restart a process that has failed, or end its part or the world."""
        run = self._run
        spec, name = process.spec, process.name
        # These codes announce a report, which decides between a restart and the end; a program in
        # another language may have sent one with any code.
        if code in (RAISED, RAISED_BY_CHANCE) or (spec.command and code > 0):
            self._await_cause(process)
        # The report has been shown and is more specific than the exit code.
        unready = code == UNREADY
        how = "failed" if process.cause.text else process.cause.blocked or _how(process, code)
        how = CANNOT_TAKE_PART if unready else how
        delay = process.fail(run.coordinator.frame, killed=code < 0)
        if delay is not None and run.log.failures.repeated(spec, code, process.cause.text):
            # `fail` has set the time of a restart.
            process.restart_at = None
            again = "failed again with the same error in the same frame"
            self._stop_for(process, f"{again}: a restart would not help")
        elif delay is not None:
            number = f"restart {process.failures} of {spec.restarts} in {delay:.2f} s"
            run.log.add(name, f"{how}; {number}")
        # A view that never starts is a wrong request, unlike one that fails later.
        elif spec.on_failure == "ignore" and not unready:
            run.log.add(name, f"{how}; continuing without it")
            process.abandoned = True
            run.abandon(process)
        else:
            times = f", {process.failures} times in a row" if process.failures > 1 else ""
            # The summary names the cause.
            if code > 0:
                self._await_cause(process)
            self._stop_for(process, f"{how}{times}")

    def _stop_for(self, process: SupervisedProcess, why: str) -> None:
        """Stop the world because of a process."""
        self._run.stop(f"{_member(process)} {process.cause.text or why}")
        raised = FAILURE_REPORT.match(process.cause.text) and not self._run.console.traceback
        more = " (--traceback shows all frames)" if raised else ""
        self._run.console.log(process.name, f"{why}; the world stops{more}", "error")

    def _await_cause(self, process: SupervisedProcess) -> None:
        """Wait for the report of a failure: the coordinator may pass it on after the exit."""
        until = self._run.machine.monotonic() + REPORT_SECONDS
        while not process.cause.text and (left := until - self._run.machine.monotonic()) > 0:
            self._run.context.pipes.wait(left)


def _how(process: SupervisedProcess, code: int) -> str:
    """How a process has ended. The request for its stacks ends one that has only just begun."""
    if process.waited and code == -STACK_SIGNAL:
        return f"did not answer for {duration(process.waited)}"
    return how_ended(code)


def _member(process: SupervisedProcess) -> str:
    """The name of the member that has ended a process, or that of the process."""
    return process.cause.member or process.name
