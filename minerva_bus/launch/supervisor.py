"""The supervisor: starts the processes of a world, waits for what happens to them, and ends all.

`Succession` replaces a coordinator that was killed, `Ending` has why and until when a world runs.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from select import PIPE_BUF
from typing import Any, Final

from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.launch.child_processes import (
    CLOSED,
    END_OF_STACKS,
    FAILED,
    NOT_STARTED,
    STACK_SIGNAL,
    STOPPED,
    UNREADY,
    ChildProcess,
    LineReader,
    caught,
    how_ended,
    on_reports,
)
from minerva_bus.launch.console import (
    Console,
    EndReport,
    RunSummary,
    Startup,
    live_line,
    starting_line,
)
from minerva_bus.launch.coordinator_process import CoordinatorStart
from minerva_bus.launch.machine_resources import check_capacity, prepare, remove_orphans
from minerva_bus.launch.process_specs import compile_agents
from minerva_bus.launch.process_table import (
    FAILURE_REPORT,
    NOTHING,
    REAL,
    REPORT_SECONDS,
    FailureCause,
    LaunchContext,
    Machine,
    ProcessLog,
    ProcessTable,
    Profiling,
    SupervisedProcess,
)
from minerva_bus.launch.registry import WorldLock
from minerva_bus.launch.run_outputs import (
    check_record,
    check_tables,
    complete_tables,
    discard_journal,
    journal_path,
)
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.coordinator import MORE_TIME, Coordinator
from minerva_bus.runtime.participants import RAISED, RAISED_BY_CHANCE
from minerva_bus.runtime.session import POOL_BYTES, expect_links
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wire.vocabulary_codec import plain_vocabulary, read_vocabulary
from minerva_bus.wording import counted, duration

STOP_SECONDS: Final = 1.0
"""Time for a world to stop on request before its processes are killed.

It is longer than HURRIED_REPORTS_WITHIN (runtime/coordinator.py), so that the coordinator can still
send its report with the digest.
"""

PROFILE_SECONDS: Final = 5.0
"""Time for a member to write its profile after the end of a world."""

CANNOT_TAKE_PART: Final = "cannot take part"
"""What is logged about a process that this world does not suit; its report has the reason."""

MAX_SUCCESSIONS: Final = 100
MAX_FAILURES: Final = 3
"""Coordinators that fail, or processes of agents that block, in one frame before a run ends."""

STOPPED_SECONDS: Final = 10.0
"""Time after which a stopped coordinator is killed.

Members without their coordinator end after their lease and BACK_WITHIN (8 s); some restarts later
the world would be given up.
"""

LATE_SECONDS: Final = 5.0
"""Interval between two looks of a launcher that was stopped as well, with all of its world."""


class Supervisor:
    """Runs one world in processes.

    `began`: the start of the program on the monotonic clock. `coordinator` creates the
    coordinator. `run` does everything; a simulation calls `start` and `turn` itself.

    The coordinator and the members report through pipes (`ReportPipe`); the methods `_on_KIND` take
    these reports.
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
        self._file, self._console, self._machine = file, console, machine
        self._context = context = LaunchContext(file, profiling, machine)
        self._startup, self._ending = Startup(began), Ending()
        self._coordinator = Succession(context, coordinator, self._receive, self._receive_line)
        self._log = ProcessLog(file.world.name, console, self._coordinator.command)
        self._processes = ProcessTable(context, self._log, self._receive)
        self._stopped = StoppedCoordinator(machine)
        self._publish: Callable[[str], None] = lambda endpoint: None
        # The last line that the coordinator has printed and that has not been shown.
        self._last_line = ""

    def run(self) -> RunSummary:
        """Run the world to its end. Raises BusError and MisuseError if it cannot begin."""
        file, context = self._file, self._context
        check_record(file)
        # With a journal, the world and its tables continue.
        if not (file.bus.journal and journal_path(file).exists()):
            check_tables(file.collect.into)
        check_capacity(len(self._processes))
        # Before the first fork, because the children inherit this setting.
        expect_links(len(file.processes))
        # Before any process starts: a second world of this name would replace the journal of the
        # first.
        lock = WorldLock(file.world.name)
        try:
            # Before the first fork, too: the children inherit the machine code, and the vocabulary
            # that each reads in its first message.
            compile_agents(file.processes, self._console.progress)
            read_vocabulary(plain_vocabulary(file.world.vocabulary))
            context.shared = self._shares_memory()
            self._startup.end("imports and checks")
            with caught(context.pipes, self._interrupted):
                try:
                    self.start(lock.publish)
                    while self.busy:
                        self.turn()
                finally:
                    self.kill_all()
        finally:
            self._console.end()
            context.close()
            # Of a coordinator that was killed and has no successor.
            if not self._ending.followed:
                complete_tables(file.collect.into, self._log.note)
                discard_journal(file)
            # Processes that are killed leave their files of shared memory behind.
            if context.shared:
                remove_orphans()
            lock.release()
        return self.summary()

    def _shares_memory(self) -> bool:
        file, needed = self._file, POOL_BYTES * (1 + len(self._processes))
        return prepare(file.bus.shared_memory, file.world.scene, needed, self._log.note)

    @property
    def endpoint(self) -> str:
        """Endpoint for local processes; empty before the coordinator listens."""
        return self._context.endpoint

    @property
    def failure(self) -> str:
        """Reason for a premature end of the world in one line; otherwise empty."""
        return self._ending.failure

    @property
    def problem(self) -> str:
        """The reason, followed by the lines of user code that caused it if they are known."""
        return self._ending.problem

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
                self._failed(process, 0)
        self._start_processes()
        self._kill_stopped(now)
        if ending.deadline is not None and now >= ending.deadline:
            self._log_unfinished()
            self.kill_all()

    def _kill_stopped(self, now: float) -> None:
        """Kill a coordinator that a signal has stopped, because all members wait for it."""
        child = self._coordinator.child
        if child is not None and self._stopped.is_given_up(child.pid, now):
            text = f"stopped by a signal for {duration(STOPPED_SECONDS)}: killing it"
            self._console.log(COORDINATOR, text, "warning")
            self._machine.kill(child.pid)

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
            for name in process.names:
                self._coordinator.command(f"started {name}")

    # --- reports of the coordinator and of members ---

    def _receive(self, report: dict[str, Any]) -> None:
        """Handle a report in the method of its kind."""
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
                for name in process.names:
                    self._coordinator.command(f"started {name}")

    def _on_log(self, member: str, text: str, details: str = "") -> None:
        process = self._processes.get(member)
        if process is not None and FAILURE_REPORT.match(text):
            # The cause explains the exit that follows, and `repeated` compares it with earlier
            # ones.
            self._log.failures.explained.update(process.names)
            process.cause = FailureCause(member, text)
        self._log.reported(member, text, details)

    def _on_unready(self, member: str, reason: str, final: bool) -> None:
        """Note why a process cannot take part; it ends. Further ones for this reason are known."""
        process = self._processes.get(member)
        if process is not None:
            process.cause = FailureCause(member, reason, final=final)
        if self._log.failures.is_new(f"{member} {reason}"):
            self._log.add(member, reason, "info")

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
            process.joined(member, self._coordinator.frame)
            self._log.failures.explained.discard(member)
            if not process.awaited:
                self._processes.queue.free(process.name)

    def _on_timed_out(self, member: str, waited: float) -> None:
        process, silence = self._processes.get(member), f"no answer for {duration(waited)}"
        if process is None:
            known = any(spec.name == member for spec in self._file.processes)
            if known and self._ending.reason is None:
                self._log.add(member, f"{silence}: restart it on its machine")
        else:
            self._processes.give_up(process, waited)

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
            processes = [process for process in self._processes if process.child is not None]
            running = [name for process in processes for name in process.names]
            stopping = now if ending.stopping_at is None else ending.stopping_at
            ending.deadline = self._file.deadlines.end_of_output(running, stopping, now)

    def _receive_line(self, line: str) -> None:
        """Handle a line that the coordinator has printed."""
        # Until it listens, the last line is the error that ends the run, which the summary names.
        listens = bool(self._context.endpoint)
        if listens and line.startswith(" "):
            # It continues the error before it, with a line of the world's code.
            self._console.log(COORDINATOR, line)
            return
        shown, self._last_line = line if listens else self._last_line, line
        if shown:
            self._console.log(COORDINATOR, shown)

    # --- ends of processes ---

    def _reap(self) -> None:
        """Handle the ends of all processes that have ended."""
        while (ended := self._machine.next_ended()) is not None:
            self._ended(*ended)

    def _ended(self, pid: int, code: int) -> None:
        """Handle the end of a process."""
        if self._coordinator.child is not None and pid == self._coordinator.child.pid:
            self._coordinator_ended(code)
            return
        process = self._processes.ended(pid)
        if process is None:
            return
        if self._ending.begun:
            if code == UNREADY:  # Its report says why.
                self._ending.fail(f"{_member(process)} {process.cause.text or CANNOT_TAKE_PART}")
            elif code and self._ending.regular:
                self._note_lost(process, code)
            # A successor must not wait for it; the first coordinator was notified that it left.
            if self._coordinator.count:
                self._abandon(process)
        elif process.restarting:
            process.restarting, process.restart_at = False, self._machine.monotonic()
        elif code == 0:
            process.exited()
        else:
            self._failed(process, code)

    def _coordinator_ended(self, code: int) -> None:
        coordinator, ending = self._coordinator, self._ending
        coordinator.ended()
        if ending.report is not None:
            return  # The deadline of its members is set.
        if ending.deadline is None and coordinator.may_continue(code):
            ended = f"failed ({self._last_line})" if code == FAILED else how_ended(code)
            text = f"{ended}; a successor continues from its journal"
            number = f"({coordinator.count + 1} of {MAX_SUCCESSIONS})"
            self._console.log(COORDINATOR, f"{text} {number}", "warning")
            coordinator.start_successor(self._processes.queued)
            return
        # It printed its error last, if it had one.
        ending.fail(self._last_line or f"the coordinator {how_ended(code)}")
        # The report that would set the deadline no longer arrives.
        ending.end_by(self._machine.monotonic() + self._report_seconds)

    def _failed(self, process: SupervisedProcess, code: int) -> None:
        """Restart a process that has failed, or end its part or the world."""
        spec, name = process.spec, process.name
        # These codes announce a report, which decides between a restart and the end; a program in
        # another language may have sent one with any code.
        if code in (RAISED, RAISED_BY_CHANCE) or (spec.command and code > 0):
            self._await_cause(process)
        # The report has been shown and is more specific than the exit code.
        unready = code == UNREADY
        how = "failed" if process.cause.text else process.cause.blocked or _how(process, code)
        how = CANNOT_TAKE_PART if unready else how
        delay = process.fail(self._coordinator.frame, killed=code < 0)
        # Methods of agents depend on string and events only: a third attempt in the same frame,
        # perhaps without the events of guests, was the last one that could differ.
        blocked = spec.agents and process.cause.blocked and process.failures >= MAX_FAILURES
        if blocked or process.cause.final:
            delay = process.restart_at = None
        if delay is not None and self._log.failures.repeated(spec, code, process.cause.text):
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
            self._note_lost(process, code)
            process.abandoned = True
            self._abandon(process)
        else:
            times = f", {process.failures} times in a row" if process.failures > 1 else ""
            # The summary names the cause.
            if code > 0:
                self._await_cause(process)
            self._stop_for(process, f"{how}{times}")

    def _note_lost(self, process: SupervisedProcess, code: int) -> None:
        """Note the end of a process without which the output of the run is incomplete.

        It is a view of the command line, or it writes files and the world file permits no failure.
        """
        name, spec = process.spec.name, process.spec
        if not spec.table or (spec.on_failure != "ignore" and name in self._file.writers):
            how = process.cause.text.partition("\n")[0] or _how(process, code)
            self._ending.incomplete.append(f"{_member(process)}: output incomplete ({how})")

    def _stop_for(self, process: SupervisedProcess, why: str) -> None:
        """Stop the world because of a process."""
        self._stop(f"{_member(process)} {process.cause.text or why}")
        raised = FAILURE_REPORT.match(process.cause.text) and not self._console.traceback
        more = " (--traceback shows all frames)" if raised else ""
        self._console.log(process.name, f"{why}; the world stops{more}", "error")

    def _await_cause(self, process: SupervisedProcess) -> None:
        """Wait for the report of a failure: the coordinator may pass it on after the exit."""
        until = self._machine.monotonic() + REPORT_SECONDS
        while not process.cause.text and (left := until - self._machine.monotonic()) > 0:
            self._context.pipes.wait(left)

    # --- stopping ---

    @property
    def _report_seconds(self) -> float:
        """Time for a process to end after the end of the world."""
        # A profile is written after the end of the world.
        return PROFILE_SECONDS if self._context.profiling.member else REPORT_SECONDS

    def _stop(self, problem: str) -> None:
        """Stop the world early; see `Ending.problem`."""
        self._ending.fail(problem)
        self._coordinator.command("stop")
        self._ending.deadline = self._machine.monotonic() + STOP_SECONDS

    def _abandon(self, process: SupervisedProcess) -> None:
        """Tell the coordinator that a process will not be started again."""
        for name in process.names:
            self._coordinator.command(f"abandoned {name}")

    def _interrupted(self, number: signal.Signals) -> None:
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
        # With a deadline, neither a successor nor a process is started again.
        self._ending.deadline = 0.0
        if self._coordinator.child is not None:
            self._machine.kill(self._coordinator.child.pid)
        self._processes.kill()
        while self.busy and (ended := self._machine.next_ended(wait=True)) is not None:
            self._ended(*ended)

    def summary(self) -> RunSummary:
        """The summary of the run."""
        joined = [name not in each.awaited for each in self._processes for name in each.names]
        now, frame = self._machine.monotonic(), self._coordinator.frame
        return self._ending.summary(self._file.world, self._startup, frame, now, joined)


def _how(process: SupervisedProcess, code: int) -> str:
    """How a process has ended. The request for its stacks ends one that has only just begun."""
    if process.waited and code == -STACK_SIGNAL:
        return f"did not answer for {duration(process.waited)}"
    return how_ended(code)


def _member(process: SupervisedProcess) -> str:
    """The name of the member that has ended a process, or that of the process."""
    return process.cause.member or process.name


class Succession:
    """A sequence of coordinator processes; `count` is the number of successors so far.

    `on_report` receives their reports, `on_line` the lines that they print. `listens_at` is the
    endpoint of the first coordinator, which its successors reuse. `frame` is the last frame
    reported.
    """

    def __init__(
        self,
        context: LaunchContext,
        make: Callable[..., Coordinator],
        on_report: Callable[[dict[str, Any]], None],
        on_line: Callable[[str], None],
    ) -> None:
        self._context = context
        self._make = make
        self._on_report_line = on_reports(on_report)
        self._on_line = on_line
        self._commands = CLOSED
        self._readers: list[LineReader] = []
        self.child: ChildProcess | None = None
        self.count = 0
        self.listens_at = ""
        self.frame = 0
        self._failed_at, self._failures = -1, 0

    def start(self, queued: frozenset[str]) -> None:
        """Start the first coordinator, or a successor that reads the journal.

        `queued`: members that have not been started yet.
        """
        context, again = self._context, self.count > 0
        file, pipes = context.file, context.pipes
        if again:
            # Members reconnect to their previous endpoint.
            file = replace(file, bus=replace(file.bus, listen=self.listens_at))
        profile, shared = context.profiling.frames, context.shared
        start = CoordinatorStart(file, self._make, profile, shared, again, queued)
        started = context.machine.start_coordinator(start, context.lifeline[0])
        self.child, self._commands, reports = started
        self._readers = [
            LineReader(pipes, reports, self._on_report_line),
            LineReader(pipes, self.child.output, self._on_line),
        ]

    def command(self, line: str) -> None:
        """Send the coordinator a line; a stuck coordinator must not block the launcher."""
        # A longer line could be written in part, and the next command would be lost with it.
        data = line.encode()[: PIPE_BUF - 1].decode(errors="ignore").encode()
        try:
            self._context.machine.write(self._commands, data + b"\n")
        except OSError:
            return  # The coordinator has died or is stuck; the launcher detects both.

    def ended(self) -> None:
        """Read the last reports and lines of a process that has ended."""
        self.child = None
        self._context.machine.close(self._commands)
        self._commands = CLOSED
        # The report about the end may be among these: it decides whether a successor is needed.
        for reader in self._readers:
            reader.finish()

    def may_continue(self, code: int) -> bool:
        """Whether to start a successor: the world runs, and the process was killed or failed.

        A failure that repeats in the same frame is not transient.
        """
        if code == FAILED:
            self._failures = self._failures + 1 if self.frame <= self._failed_at else 1
            self._failed_at = max(self._failed_at, self.frame)
        # Without an endpoint the first coordinator has never listened, so there is no run to
        # continue.
        unexpected = code < 0 or (code == FAILED and self._failures < MAX_FAILURES)
        return unexpected and bool(self._context.endpoint) and self.count < MAX_SUCCESSIONS

    def start_successor(self, queued: frozenset[str]) -> None:
        """Start a successor."""
        self.count += 1
        self.start(queued)


@dataclass(slots=True)
class Ending:
    """The end of the world; at the `deadline` its remaining processes are killed.

    `problem`: the reason for a premature end, followed by the lines of user code that caused it if
    they are known. `reason`: that of the coordinator, None before it stops, which is at
    `stopping_at`. `report`: its last report. `incomplete`: damaged or missing output of processes.
    `followed`: another launcher's coordinator runs the world. Times are of the monotonic clock.
    """

    problem: str = ""
    reason: str | None = None
    report: EndReport | None = None
    deadline: float | None = None
    stopping_at: float | None = None
    interrupts: int = 0
    followed: bool = False
    incomplete: list[str] = field(default_factory=list[str])

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
        self, world: WorldSpec, startup: Startup, frame: int, now: float, joined: Sequence[bool]
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
        report = replace(report, incomplete=[*report.incomplete, *self.incomplete])
        return RunSummary.of(world, report, startup, self.failure)


class StoppedCoordinator:
    """Measures for how long the coordinator has been stopped while the launcher was running."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._looked_at = 0.0
        self._pid = 0
        self._since = 0.0

    def is_given_up(self, pid: int, now: float) -> bool:
        """Whether to kill it; to be called at least once a second, with the monotonic time."""
        late = now - self._looked_at > LATE_SECONDS
        self._looked_at = now
        if late or pid != self._pid or not self._machine.is_stopped(pid):
            self._pid, self._since = pid, now
        return now - self._since >= STOPPED_SECONDS
