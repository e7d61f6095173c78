"""Reports of a world's coordinator and of its members, as the launcher handles them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from minerva_bus.launch.console import live_line, starting_line
from minerva_bus.launch.process_log import FAILURE_REPORT
from minerva_bus.launch.process_table import FailureCause
from minerva_bus.launch.summary import EndReport
from minerva_bus.launch.supervised_run import SupervisedRun
from minerva_bus.launch.traces import END_OF_STACKS, NOT_STARTED, STOPPED
from minerva_bus.wire.keys import COORDINATOR
from minerva_bus.wording import counted, duration


class CoordinatorReports:
    """Handles each kind of report of `_Reporter` (coordinator_process.py) in a method of its name.

    A member reports why this world does not suit it. `publish` receives the endpoint of the
    coordinator. `last_line`: the last line that it has printed and that has not been shown.
    """

    def __init__(self, run: SupervisedRun) -> None:
        self._run = run
        self.publish: Callable[[str], None] = lambda endpoint: None
        self.last_line = ""

    def receive(self, report: dict[str, Any]) -> None:
        """Handle a report."""
        getattr(self, f"_on_{report.pop('kind')}")(**report)

    def _on_listening(self, endpoint: str, listens_at: str) -> None:
        """Local processes connect to `endpoint`, others to the endpoint it `listens_at`."""
        run = self._run
        if self.last_line and not run.context.endpoint:
            run.console.log(COORDINATOR, self.last_line)
        run.context.endpoint, run.coordinator.listens_at = endpoint, listens_at
        self.publish(endpoint)
        # A successor: the members run already, and their endpoint is the same.
        if run.coordinator.count:
            self._inform_successor()
            return
        run.startup.end("bus")
        run.log.note(f"{counted(len(run.processes), 'process')}, bus at {endpoint}")
        remote = [process.name for process in run.file.processes if process.elsewhere]
        if remote:
            run.log.note(f"to be attached from other machines: {', '.join(remote)}")
        for note in run.file.notes:
            run.log.note(note)
        if run.ending.deadline is None:
            # Otherwise an interrupt has arrived before the first member was started.
            for process in run.processes:
                run.processes.enqueue(process)

    def _inform_successor(self) -> None:
        """Send a new coordinator the states of processes that its predecessor had."""
        run = self._run
        run.log.note(f"a new coordinator listens at {run.context.endpoint}")
        if run.ending.reason is not None:  # Only the launcher has it, not the journal.
            run.coordinator.command(f"end {run.ending.reason}")
        # The journal contains neither processes that are not restarted nor those that are starting.
        for process in run.processes:
            if process.abandoned or (run.ending.reason is not None and process.child is None):
                run.abandon(process)
            elif process.child is not None and process.joined_at is None:
                for name in process.names:
                    run.coordinator.command(f"started {name}")

    def _on_log(self, member: str, text: str, details: str = "") -> None:
        process = self._run.processes.get(member)
        if process is not None and FAILURE_REPORT.match(text):
            # The cause explains the exit that follows, and `repeated` compares it with earlier
            # ones.
            self._run.log.failures.explained.update(process.names)
            process.cause = FailureCause(member, text)
        self._run.log.reported(member, text, details)

    def _on_unready(self, member: str, reason: str) -> None:
        """Note why a process cannot take part; it ends. Further ones for this reason are known."""
        process = self._run.processes.get(member)
        if process is not None:
            process.cause = FailureCause(member, reason)
        if self._run.log.failures.is_new(f"{member} {reason}"):
            self._run.log.add(member, reason, "info")

    def _on_note(self, text: str) -> None:
        self._run.log.note(text)

    def _on_status(self, **status: Any) -> None:
        run = self._run
        world, console = run.file.world, run.console
        console.frame = run.coordinator.frame = int(status["frame"])
        if run.startup.first_frame is not None or status["frame"] or not status["waiting"]:
            console.live(live_line(world.name, status, world.frames, run.startup.began))
            return
        total = len(run.file.processes)
        text = starting_line(status, total)
        # The lines about the members that frame 0 waits for, and about restarts, say more.
        is_reported = int(status["members"]) >= total or any(p.failures for p in run.processes)
        if console.terminal:
            console.progress(world.name, min(int(status["members"]), total), total, text)
        elif not is_reported:
            console.periodic(f"{world.name}: {text}", run.machine.monotonic())

    def _on_first_frame(self, frame: int, at: float) -> None:
        self._run.startup.completed(frame, at)

    def _on_joined(self, member: str) -> None:
        run = self._run
        process = run.processes.get(member)
        if process is not None:
            process.joined(member, run.coordinator.frame)
            run.log.failures.explained.discard(member)
            if not process.awaited:
                run.processes.queue.free(process.name)

    def _on_timed_out(self, member: str, waited: float) -> None:
        run = self._run
        process, silence = run.processes.get(member), f"no answer for {duration(waited)}"
        if process is None:
            known = any(spec.name == member for spec in run.file.processes)
            if known and run.ending.reason is None:
                run.log.add(member, f"{silence}: restart it on its machine")
        else:
            run.processes.give_up(process, waited)

    def _on_restart(self, member: str) -> None:
        process = self._run.processes.get(member)
        if process is not None and self._run.ending.reason is None:
            self._run.log.add(member, "restarting on request")
            process.restart()

    def _on_stack(self, member: str) -> None:
        """Keep the stacks of a process in its log, followed by a line that ends them."""
        run = self._run
        process = run.processes.get(member)
        child = None if process is None else process.child
        stacks = [] if process is None else run.processes.stacks(process)
        is_stopped = child is not None and run.machine.is_stopped(child.pid)
        end = NOT_STARTED if child is None else STOPPED if is_stopped else END_OF_STACKS
        run.log.keep(member, "\n".join([*filter(None, stacks), end]), "info")

    def _on_stopping(self, reason: str) -> None:
        self._run.ending.reason = reason
        self._run.ending.stopping_at = self._run.machine.monotonic()

    def _on_followed(self) -> None:
        self._run.ending.followed = True

    def _on_ended(self, **report: Any) -> None:
        run = self._run
        ending = run.ending
        ending.report = EndReport(**report)
        # A view may still draw the last frame or write its file; only an interrupt or a failure is
        # urgent.
        now = run.machine.monotonic()
        ending.deadline = now + run.report_seconds
        if ending.regular:
            processes = [process for process in run.processes if process.child is not None]
            running = [name for process in processes for name in process.names]
            stopping = now if ending.stopping_at is None else ending.stopping_at
            ending.deadline = run.file.deadlines.end_of_output(running, stopping, now)

    def receive_line(self, line: str) -> None:
        """Handle a line that the coordinator has printed."""
        # Until it listens, the last line is the error that ends the run, which the summary names.
        listens = bool(self._run.context.endpoint)
        if listens and line.startswith(" "):
            # It continues the error before it, with a line of the world's code.
            self._run.console.log(COORDINATOR, line)
            return
        shown, self.last_line = line if listens else self.last_line, line
        if shown:
            self._run.console.log(COORDINATOR, shown)
