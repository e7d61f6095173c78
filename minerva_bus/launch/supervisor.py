"""The supervisor: starts the processes of a world, restarts failed ones, and ends all."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any, Final

from minerva_bus.launch.capacity import check_capacity
from minerva_bus.launch.collecting import check_tables, complete_tables
from minerva_bus.launch.compiling import compile_agents
from minerva_bus.launch.console import Console, live_line, starting_line
from minerva_bus.launch.ending import Ending
from minerva_bus.launch.forking import FAILED, UNREADY, how_ended
from minerva_bus.launch.interrupts import caught
from minerva_bus.launch.journaling import discard_journal, journal_path
from minerva_bus.launch.machine import REAL, LaunchContext, Machine
from minerva_bus.launch.memory import prepare, remove_orphans
from minerva_bus.launch.process_log import FAILURE_REPORT, ProcessLog
from minerva_bus.launch.process_table import (
    CANNOT_TAKE_PART,
    REPORT_SECONDS,
    ProcessTable,
    SupervisedProcess,
)
from minerva_bus.launch.profiling import NOTHING, Profiling
from minerva_bus.launch.recording import check_record
from minerva_bus.launch.region_layout import RegionSpec
from minerva_bus.launch.registry import WorldLock
from minerva_bus.launch.stopped import STOPPED_SECONDS, StoppedChildren
from minerva_bus.launch.succession import MAX_SUCCESSIONS, Succession
from minerva_bus.launch.summary import EndReport, RunSummary, Startup
from minerva_bus.launch.traces import END_OF_STACKS, NOT_STARTED, STOPPED
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.member import RAISED, RAISED_BY_CHANCE
from minerva_bus.runtime.monitor import MORE_TIME
from minerva_bus.runtime.session import POOL_BYTES, expect_links
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wording import counted, duration

STOP_SECONDS: Final = 1.0
"""Time for a world to stop on request before its processes are killed.

It is longer than HURRIED_REPORTS_WITHIN (runtime/monitor.py), so that the coordinator can still
send its report with the digest.
"""

PROFILE_SECONDS: Final = 5.0
"""Time for a member to write its profile after the end of a world."""


class Supervisor:
    """Runs one world in processes.

    `began`: the start of the program on the monotonic clock. `coordinator` creates the
    coordinator. `run` does everything; a simulation calls `start` and `turn` itself.
    """

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        profiling: Profiling = NOTHING,
        coordinator: Callable[..., Coordinator] = Coordinator,
        machine: Machine = REAL,
    ) -> None:
        self._machine = machine
        self._file = file
        self._console = console
        self._startup = Startup(began)
        # A profile is written after the end of the world.
        self._report_seconds = PROFILE_SECONDS if profiling.member else REPORT_SECONDS
        context = self._context = LaunchContext(file, profiling, machine)
        self._coordinator = Succession(context, coordinator, self._on_report, self._on_last_line)
        self._log = ProcessLog(file.world.name, console, self._coordinator.command)
        self._processes = ProcessTable(context, self._log)
        self._publish: Callable[[str], None] = lambda endpoint: None
        self._stopped = StoppedChildren(machine)
        self._last_line = ""
        self._ending = Ending()

    def run(self) -> RunSummary:
        """Run the world to its end. Raises BusError and MisuseError if it cannot begin."""
        check_record(self._file)
        # With a journal, the world and its tables continue.
        if not (self._file.bus.journal and journal_path(self._file).exists()):
            check_tables(self._file.collect.into)
        check_capacity(len(self._processes))
        # Before the first fork, because the children inherit this setting.
        expect_links(len(self._file.processes))
        # Before any process starts: a second world of this name would replace the journal of the
        # first.
        lock = WorldLock(self._file.world.name)
        try:
            # Before the first fork, too: the children inherit the machine code.
            compile_agents(self._file.processes, self._console.progress)
            self._context.shared = self._shares_memory()
            self._startup.end("imports and checks")
            with caught(self._context.pipes, self._on_interrupt):
                try:
                    self.start(lock.publish)
                    while self.busy:
                        self.turn()
                finally:
                    self.kill_all()
        finally:
            self._console.end()
            self._context.close()
            # Of a coordinator that was killed and has no successor.
            if not self._ending.followed:
                complete_tables(self._file.collect.into, self._log.note)
                discard_journal(self._file)
            # Processes that are killed leave their files of shared memory behind.
            if self._context.shared:
                remove_orphans()
            lock.release()
        return self.summary()

    def _shares_memory(self) -> bool:
        needed = POOL_BYTES * (1 + len(self._processes))
        return prepare(self._file.bus.shared_memory, self._file.world.scene, needed, self._log.note)

    @property
    def endpoint(self) -> str:
        """Endpoint for local processes; empty before the coordinator listens."""
        return self._context.endpoint

    @property
    def failure(self) -> str:
        """Reason for a premature end of the world; otherwise empty."""
        return self._ending.failure

    # --- turns ---

    def start(self, publish: Callable[[str], None]) -> None:
        """Start the coordinator; `publish` receives its endpoint."""
        self._publish = publish
        self._coordinator.start(self._processes.names)

    @property
    def busy(self) -> bool:
        """Whether a process runs."""
        return self._coordinator.child is not None or self._processes.running

    def turn(self) -> None:
        """Wait for reports, output, signals or a deadline, and handle them."""
        self._context.pipes.wait(self.patience())
        self._reap()
        now, ending = self._machine.monotonic(), self._ending
        for process in self._processes:
            if process.restart_at is not None and now >= process.restart_at:
                self._processes.enqueue(process)
            # It has ended with code 0 without a report of the world's end: a failure, too.
            if process.exited_at is not None and now >= process.exited_at and ending.reason is None:
                self._on_failure(process, 0)
        self._start_processes()
        self._kill_stopped(now)
        if ending.deadline is not None and now >= ending.deadline:
            self._log_unfinished()
            self.kill_all()

    def _kill_stopped(self, now: float) -> None:
        """Kill a coordinator or region that a signal has stopped, because others wait for it."""
        children = {
            process.child.pid: process.name
            for process in self._processes
            if process.child is not None and isinstance(process.spec, RegionSpec)
        }
        if self._coordinator.child is not None:
            children[self._coordinator.child.pid] = COORDINATOR
        for pid in self._stopped.given_up(children, now):
            text = f"stopped by a signal for {duration(STOPPED_SECONDS)}: killing it"
            self._console.log(children[pid], text, "warning")
            self._machine.kill(pid)

    def patience(self) -> float:
        """Seconds until the next deadline, at most 1 s."""
        now = self._machine.monotonic()
        times = [at for process in self._processes for at in process.due]
        own = self._ending.deadline, self._processes.queue.next_at(now)
        times += [at for at in own if at is not None]
        return max(0.0, min(times) - now) if times else 1.0

    def _start_processes(self) -> None:
        """Start the processes that have a slot; from now on the coordinator waits for them."""
        if self._ending.begun:
            self._processes.queue.clear()
        while (process := self._processes.start_next()) is not None:
            self._coordinator.command(f"started {process.name}")

    # --- reports of the coordinator ---

    def _on_report(self, report: dict[str, Any]) -> None:
        getattr(self, f"_on_{report.pop('kind')}")(**report)

    def _on_listening(self, endpoint: str, listens_at: str) -> None:
        """Local processes connect to `endpoint`, others to the endpoint it `listens_at`."""
        if self._last_line and not self._context.endpoint:
            self._console.log(COORDINATOR, self._last_line)
        self._context.endpoint, self._coordinator.listens_at = endpoint, listens_at
        self._publish(endpoint)
        # A successor: the members run already, and their endpoint is the same.
        if self._coordinator.count:
            self._inform_successor()
            return
        self._startup.end("bus")
        self._log.note(f"{counted(len(self._processes), 'process')}, bus at {endpoint}")
        remote = [process.name for process in self._file.processes if process.elsewhere]
        if remote:
            self._log.note(f"to be attached from other machines: {', '.join(remote)}")
        for note in self._file.notes:
            self._log.note(note)
        if self._ending.deadline is None:
            # Otherwise an interrupt has arrived before the first member was started.
            for process in self._processes:
                self._processes.enqueue(process)

    def _inform_successor(self) -> None:
        """Send a new coordinator the states of processes that its predecessor had."""
        self._log.note(f"a new coordinator listens at {self._context.endpoint}")
        if self._ending.reason is not None:  # Only the launcher has it, not the journal.
            self._coordinator.command(f"end {self._ending.reason}")
        # The journal contains neither processes that are not restarted nor those that are starting.
        for process in self._processes:
            if process.abandoned or (self._ending.reason is not None and process.child is None):
                self._abandon(process)
            elif process.child is not None and process.joined_at is None:
                self._coordinator.command(f"started {process.name}")

    def _on_log(self, member: str, text: str, details: str = "") -> None:
        process = self._processes.get(member)
        if process is not None and FAILURE_REPORT.match(text):
            # The cause explains the exit that follows, and `repeated` compares it with earlier
            # ones.
            self._log.failures.explained.add(member)
            process.cause = text
        self._log.reported(member, text, details)

    def _on_note(self, text: str) -> None:
        self._log.note(text)

    def _on_status(self, **status: Any) -> None:
        world, console = self._file.world, self._console
        console.frame = self._coordinator.frame = int(status["frame"])
        if self._startup.first_frame is not None or status["frame"] or not status["waiting"]:
            console.live(live_line(world.name, status, world.frames, self._startup.began))
            return
        total = len(self._file.processes)
        text = starting_line(status, total)
        # The lines about the members that frame 0 waits for, and about restarts, say more.
        is_reported = int(status["members"]) >= total or any(p.failures for p in self._processes)
        if console.terminal:
            console.progress(world.name, min(int(status["members"]), total), total, text)
        elif not is_reported:
            console.periodic(f"{world.name}: {text}", self._machine.monotonic())

    def _on_first_frame(self, frame: int, at: float) -> None:
        self._startup.completed(frame, at)

    def _on_joined(self, member: str) -> None:
        process = self._processes.get(member)
        if process is not None:
            process.joined(self._coordinator.frame)
            self._log.failures.explained.discard(member)
            self._processes.queue.free(member)

    def _on_timed_out(self, member: str, waited: float) -> None:
        process, silence = self._processes.get(member), f"no answer for {duration(waited)}"
        if process is None:
            known = any(spec.name == member for spec in self._file.processes)
            if known and self._ending.reason is None:
                self._log.add(member, f"{silence}: restart it on its machine")
        elif process.child is not None:
            process.waited = waited
            self._log.failures.explained.add(member)
            # Before it is killed: this is the only trace of its activity.
            process.blocked = self._log.blocked(member, self._processes.stacks(process), waited)
            self._machine.kill(process.child.pid)

    def _on_restart(self, member: str) -> None:
        process = self._processes.get(member)
        if process is not None and self._ending.reason is None:
            self._log.add(member, "restarting on request")
            process.restart()

    def _on_stack(self, member: str) -> None:
        """Keep the stacks of a process in its log, followed by a line that ends them."""
        process = self._processes.get(member)
        child = None if process is None else process.child
        stacks = [] if process is None else self._processes.stacks(process)
        is_stopped = child is not None and self._machine.is_stopped(child.pid)
        end = NOT_STARTED if child is None else STOPPED if is_stopped else END_OF_STACKS
        self._log.keep(member, "\n".join([*filter(None, stacks), end]), "info")

    def _on_stopping(self, reason: str) -> None:
        self._ending.reason = reason
        self._ending.stopping_at = self._machine.monotonic()

    def _on_followed(self) -> None:
        self._ending.followed = True

    def _on_ended(self, **report: Any) -> None:
        ending = self._ending
        ending.report = EndReport(**report)
        # A view may still draw the last frame or write its file; only an interrupt or a failure is
        # urgent.
        now = self._machine.monotonic()
        ending.deadline = now + self._report_seconds
        if ending.regular:
            running = [process.name for process in self._processes if process.child is not None]
            stopping = now if ending.stopping_at is None else ending.stopping_at
            ending.deadline = self._file.deadlines.end_of_output(running, stopping, now)

    def _on_last_line(self, line: str) -> None:
        # Until it listens, the last line is the error that ends the run, which the summary names.
        listens = bool(self._context.endpoint)
        if listens and line.startswith(" "):
            # It continues the error before it, with a line of the world's code.
            self._console.log(COORDINATOR, line)
            return
        shown, self._last_line = line if listens else self._last_line, line
        if shown:
            self._console.log(COORDINATOR, shown)

    # --- processes that end ---

    def _reap(self) -> None:
        while (ended := self._machine.next_ended()) is not None:
            self._on_exit(*ended)

    def _on_exit(self, pid: int, code: int) -> None:
        if self._coordinator.child is not None and pid == self._coordinator.child.pid:
            self._on_coordinator_exit(code)
            return
        process = self._processes.ended(pid)
        if process is None:
            return
        if self._ending.begun:
            if code == UNREADY:  # Its output says why.
                self._ending.fail(f"{process.name} {process.cause or CANNOT_TAKE_PART}")
            # A successor must not wait for it; the first coordinator was notified that it left.
            if self._coordinator.count:
                self._abandon(process)
        elif process.restarting:
            process.restarting, process.restart_at = False, self._machine.monotonic()
        elif code == 0:
            process.exited()
        else:
            self._on_failure(process, code)

    def _on_coordinator_exit(self, code: int) -> None:
        coordinator, ending = self._coordinator, self._ending
        coordinator.ended()
        if ending.report is not None:
            return  # The deadline of its members is set.
        if ending.deadline is None and coordinator.may_continue(code):
            ended = f"failed ({self._last_line})" if code == FAILED else how_ended(code)
            text = f"{ended}; a successor continues from its journal"
            number = f"({coordinator.count + 1} of {MAX_SUCCESSIONS})"
            self._console.log(COORDINATOR, f"{text} {number}", "warning")
            coordinator.start_successor(self._processes.queue.queued)
            return
        # It printed its error last, if it had one.
        ending.fail(self._last_line or f"the coordinator {how_ended(code)}")
        # The report that would set the deadline no longer arrives.
        ending.end_by(self._machine.monotonic() + self._report_seconds)

    def _on_failure(self, process: SupervisedProcess, code: int) -> None:
        spec, name = process.spec, process.name
        # These codes announce a report, which decides between a restart and the end.
        if code in (RAISED, RAISED_BY_CHANCE):
            self._await_cause(process)
        # The report has been shown and is more specific than the exit code.
        unready = code == UNREADY
        how = "failed" if process.cause else process.blocked or how_ended(code)
        how = CANNOT_TAKE_PART if unready else how
        delay = process.fail(self._coordinator.frame)
        if delay is not None and self._log.failures.repeated(spec, code, process.cause):
            # `fail` has set the time of a restart.
            process.restart_at = None
            again = "failed again with the same error in the same frame"
            self._stop_for(process, f"{again}: a restart would not help")
        elif delay is not None:
            number = f"restart {process.failures} of {spec.restarts} in {delay:.2f} s"
            self._log.add(name, f"{how}; {number}")
        # A view that never starts is a wrong request, unlike one that fails later.
        elif spec.on_failure == "ignore" and not unready:
            self._log.add(name, f"{how}; continuing without it")
            process.abandoned = True
            self._abandon(process)
        else:
            times = f", {process.failures} times in a row" if process.failures > 1 else ""
            # The summary names the cause.
            if code > 0:
                self._await_cause(process)
            self._stop_for(process, f"{how}{times}")

    def _stop_for(self, process: SupervisedProcess, why: str) -> None:
        """Stop the world because of a process; the summary has the cause in one line."""
        cause = process.cause.partition("\n")[0]
        self._stop(f"{process.name} {cause or why}")
        raised = FAILURE_REPORT.match(cause) and not self._console.traceback
        more = " (--traceback shows all frames)" if raised else ""
        self._console.log(process.name, f"{why}; the world stops{more}", "error")

    def _await_cause(self, process: SupervisedProcess) -> None:
        """Wait for the report of a failure: the coordinator may pass it on after the exit."""
        until = self._machine.monotonic() + REPORT_SECONDS
        while not process.cause and (left := until - self._machine.monotonic()) > 0:
            self._context.pipes.wait(left)

    def _abandon(self, process: SupervisedProcess) -> None:
        self._coordinator.command(f"abandoned {process.name}")

    # --- stopping ---

    def _stop(self, failure: str) -> None:
        self._ending.fail(failure)
        self._coordinator.command("stop")
        self._ending.deadline = self._machine.monotonic() + STOP_SECONDS

    def _on_interrupt(self, number: signal.Signals) -> None:
        self._ending.interrupts += 1
        if self._ending.interrupts > 1:
            # After a second interrupt, the next turn kills all processes.
            self._ending.deadline = 0.0
        elif self._ending.deadline is None:
            self._stop("interrupted" if number == signal.SIGINT else "terminated")

    def _log_unfinished(self) -> None:
        """Name the members that are killed after a regular end."""
        if self._ending.failure or self._ending.interrupts:
            return
        for process in self._processes:
            if process.child is not None:
                text = "still running after the end of the world: killing it"
                advice = f"; its files may be incomplete{MORE_TIME}"
                self._console.log(process.name, f"{text}{advice}", "warning")

    def kill_all(self) -> None:
        """Kill all processes, start no others, and wait for their ends."""
        # With a deadline, `_on_exit` starts neither a successor nor a process again.
        self._ending.deadline = 0.0
        if self._coordinator.child is not None:
            self._machine.kill(self._coordinator.child.pid)
        self._processes.kill()
        while self.busy and (ended := self._machine.next_ended(wait=True)) is not None:
            self._on_exit(*ended)

    def summary(self) -> RunSummary:
        """The summary of the run."""
        joined = [process.joined_at is not None for process in self._processes]
        now, frame = self._machine.monotonic(), self._coordinator.frame
        return self._ending.summary(self._file.world, self._startup, frame, now, joined)
