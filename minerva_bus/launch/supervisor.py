"""The supervisor: starts the processes of a world, waits for what happens to them, and ends all.

`coordinator_reports.py` handles what the coordinator reports, `process_exits.py` the ends of
processes.
"""

from __future__ import annotations

import signal
from collections.abc import Callable

from minerva_bus.launch.capacity import check_capacity
from minerva_bus.launch.collecting import check_tables, complete_tables
from minerva_bus.launch.compiling import compile_agents
from minerva_bus.launch.console import Console
from minerva_bus.launch.coordinator_reports import CoordinatorReports
from minerva_bus.launch.ending import Ending
from minerva_bus.launch.interrupts import caught
from minerva_bus.launch.journaling import discard_journal, journal_path
from minerva_bus.launch.machine import REAL, LaunchContext, Machine
from minerva_bus.launch.memory import prepare, remove_orphans
from minerva_bus.launch.process_exits import ProcessExits
from minerva_bus.launch.process_log import ProcessLog
from minerva_bus.launch.process_table import ProcessTable
from minerva_bus.launch.profiling import NOTHING, Profiling
from minerva_bus.launch.recording import check_record
from minerva_bus.launch.registry import WorldLock
from minerva_bus.launch.stopped import STOPPED_SECONDS, StoppedCoordinator
from minerva_bus.launch.succession import Succession
from minerva_bus.launch.summary import RunSummary, Startup
from minerva_bus.launch.supervised_run import SupervisedRun
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.monitor import MORE_TIME
from minerva_bus.runtime.session import POOL_BYTES, expect_links
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wording import duration


class Supervisor:
    """Runs one world in processes.

    `began`: the start of the program on the monotonic clock. `coordinator` creates the
    coordinator. `run` does everything; a simulation calls `start` and `turn` itself.
    """

    _reports: CoordinatorReports

    def __init__(
        self,
        file: WorldFile,
        console: Console,
        began: float,
        profiling: Profiling = NOTHING,
        coordinator: Callable[..., Coordinator] = Coordinator,
        machine: Machine = REAL,
    ) -> None:
        context = LaunchContext(file, profiling, machine)
        # The handlers of its reports are set later than the callbacks.
        succession = Succession(
            context,
            coordinator,
            lambda report: self._reports.receive(report),
            lambda line: self._reports.receive_line(line),
        )
        log = ProcessLog(file.world.name, console, succession.command)
        processes = ProcessTable(context, log, lambda report: self._reports.receive(report))
        startup = Startup(began)
        self._run = SupervisedRun(context, console, startup, Ending(), succession, log, processes)
        self._reports = CoordinatorReports(self._run)
        self._exits = ProcessExits(self._run, self._reports)
        self._stopped = StoppedCoordinator(machine)

    def run(self) -> RunSummary:
        """Run the world to its end. Raises BusError and MisuseError if it cannot begin."""
        run = self._run
        file, context = run.file, run.context
        check_record(file)
        # With a journal, the world and its tables continue.
        if not (file.bus.journal and journal_path(file).exists()):
            check_tables(file.collect.into)
        check_capacity(len(run.processes))
        # Before the first fork, because the children inherit this setting.
        expect_links(len(file.processes))
        # Before any process starts: a second world of this name would replace the journal of the
        # first.
        lock = WorldLock(file.world.name)
        try:
            # Before the first fork, too: the children inherit the machine code.
            compile_agents(file.processes, run.console.progress)
            context.shared = self._shares_memory()
            run.startup.end("imports and checks")
            with caught(context.pipes, self._on_interrupt):
                try:
                    self.start(lock.publish)
                    while self.busy:
                        self.turn()
                finally:
                    self.kill_all()
        finally:
            run.console.end()
            context.close()
            # Of a coordinator that was killed and has no successor.
            if not run.ending.followed:
                complete_tables(file.collect.into, run.log.note)
                discard_journal(file)
            # Processes that are killed leave their files of shared memory behind.
            if context.shared:
                remove_orphans()
            lock.release()
        return self.summary()

    def _shares_memory(self) -> bool:
        file, needed = self._run.file, POOL_BYTES * (1 + len(self._run.processes))
        return prepare(file.bus.shared_memory, file.world.scene, needed, self._run.log.note)

    @property
    def endpoint(self) -> str:
        """Endpoint for local processes; empty before the coordinator listens."""
        return self._run.context.endpoint

    @property
    def failure(self) -> str:
        """Reason for a premature end of the world in one line; otherwise empty."""
        return self._run.ending.failure

    @property
    def problem(self) -> str:
        """The reason, followed by the lines of user code that caused it if they are known."""
        return self._run.ending.problem

    # --- turns ---

    def start(self, publish: Callable[[str], None]) -> None:
        """Start the coordinator; `publish` receives its endpoint."""
        self._reports.publish = publish
        self._run.coordinator.start(self._run.processes.names)

    @property
    def busy(self) -> bool:
        """Whether a process runs."""
        return self._run.coordinator.child is not None or self._run.processes.running

    def turn(self) -> None:
        """Wait for reports, output, signals or a deadline, and handle them."""
        run = self._run
        run.context.pipes.wait(self.patience())
        self._exits.reap()
        now, ending = run.machine.monotonic(), run.ending
        for process in run.processes:
            if process.restart_at is not None and now >= process.restart_at:
                run.processes.enqueue(process)
            # It has ended with code 0 without a report of the world's end: a failure, too.
            if process.exited_at is not None and now >= process.exited_at and ending.reason is None:
                self._exits.failed(process, 0)
        self._start_processes()
        self._kill_stopped(now)
        if ending.deadline is not None and now >= ending.deadline:
            self._log_unfinished()
            self.kill_all()

    def _kill_stopped(self, now: float) -> None:
        """Kill a coordinator that a signal has stopped, because all members wait for it."""
        run = self._run
        child = run.coordinator.child
        if child is not None and self._stopped.is_given_up(child.pid, now):
            text = f"stopped by a signal for {duration(STOPPED_SECONDS)}: killing it"
            run.console.log(COORDINATOR, text, "warning")
            run.machine.kill(child.pid)

    def patience(self) -> float:
        """Seconds until the next deadline, at most 1 s."""
        run = self._run
        now = run.machine.monotonic()
        times = [at for process in run.processes for at in process.due]
        own = run.ending.deadline, run.processes.queue.next_at(now)
        times += [at for at in own if at is not None]
        return max(0.0, min(times) - now) if times else 1.0

    def _start_processes(self) -> None:
        """Start the processes that have a slot; from now on the coordinator waits for them."""
        run = self._run
        if run.ending.begun:
            run.processes.queue.clear()
        while (process := run.processes.start_next()) is not None:
            for name in process.names:
                run.coordinator.command(f"started {name}")

    # --- stopping ---

    def _on_interrupt(self, number: signal.Signals) -> None:
        run = self._run
        run.ending.interrupts += 1
        if run.ending.interrupts > 1:
            # After a second interrupt, the next turn kills all processes.
            run.ending.deadline = 0.0
        elif run.ending.deadline is None:
            run.stop("interrupted" if number == signal.SIGINT else "terminated")

    def _log_unfinished(self) -> None:
        """Name the members that are killed after a regular end."""
        run = self._run
        if run.ending.failure or run.ending.interrupts:
            return
        for process in run.processes:
            if process.child is not None:
                text = "still running after the end of the world: killing it"
                advice = f"; its files may be incomplete{MORE_TIME}"
                run.console.log(process.name, f"{text}{advice}", "warning")

    def kill_all(self) -> None:
        """Kill all processes, start no others, and wait for their ends."""
        run = self._run
        # With a deadline, `ProcessExits` starts neither a successor nor a process again.
        run.ending.deadline = 0.0
        if run.coordinator.child is not None:
            run.machine.kill(run.coordinator.child.pid)
        run.processes.kill()
        while self.busy and (ended := run.machine.next_ended(wait=True)) is not None:
            self._exits.ended(*ended)

    def summary(self) -> RunSummary:
        """The summary of the run."""
        run = self._run
        joined = [name not in each.awaited for each in run.processes for name in each.names]
        now, frame = run.machine.monotonic(), run.coordinator.frame
        return run.ending.summary(run.file.world, run.startup, frame, now, joined)
