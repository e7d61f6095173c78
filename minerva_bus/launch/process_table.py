"""The local processes of a world's members: their code, starts, restarts, output and failures.

`run_member` is what such a process runs. `Machine` is the launcher's interface to the operating
system; a simulation passes a machine of its own. `ProcessTable` has the states of all processes.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from minerva_bus.errors import MisuseError, SceneError, WorldFileError, nearest
from minerva_bus.files import check_output, write_output
from minerva_bus.frame.member_side import Unready
from minerva_bus.launch import child_processes, machine_resources
from minerva_bus.launch.child_processes import (
    CLOSED,
    STACK_SIGNAL,
    UNREADY,
    ChildProcess,
    LineReader,
    Pipes,
    ReportPipe,
    blocked_at,
    is_stack,
    on_reports,
)
from minerva_bus.launch.console import Console
from minerva_bus.launch.coordinator_process import CoordinatorStart, run_coordinator
from minerva_bus.launch.process_specs import SERVICES, ProcessSpec, by_process, forgotten
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.joining import STARTED_HERE
from minerva_bus.runtime.participants import RAISED_BY_CHANCE, MemberProcess
from minerva_bus.values import fast_dataclass
from minerva_bus.wording import duration, install

# --- the code of a process ---


@fast_dataclass
class MemberStart:
    """Arguments of a process: its name, its members, and the endpoint of their world."""

    name: str
    members: tuple[ProcessSpec, ...]
    world: str
    endpoint: str
    shared: bool
    profiling: Profiling


LASTING: Final = (MisuseError, WorldFileError, SceneError, ValueError)
"""Errors about options, files or the world, which another attempt would meet again."""


def run_member(start: MemberStart, reports: ReportPipe) -> int:
    """Run members of a world to its end; returns the exit code.

    It reports if one cannot take part.
    """
    process = _process(start)
    try:
        named = start.profiling.member in {member.name for member in start.members}
        path = profile_path(start.world, start.profiling.member)
        return sampled(process.run, path) if named else process.run()
    except Unready as error:
        name, cause = process.running.name, error.__cause__
        # Only a host of another version has no cause. Others, such as a missing device, may pass.
        final = cause is None or isinstance(cause, LASTING)
        reason = str(error).removeprefix(f"{name} ")
        reports.send("unready", member=name, reason=reason, final=final)
        return UNREADY


def _process(start: MemberStart) -> MemberProcess:
    def log(line: str) -> None:
        print(line, flush=True)  # noqa: T201

    # With STARTED_HERE members wait for their greetings without limit: the launcher takes into
    # account how many processes start at the same time, and kills late ones.
    return MemberProcess(
        [member.make_member() for member in start.members],
        start.world,
        start.endpoint,
        log,
        shared=start.shared,
        arrival=STARTED_HERE,
    )


@fast_dataclass
class Profiling:
    """Scope of a profile: the `frames`, and the code of a `member` ("": of none)."""

    frames: bool = False
    member: str = ""

    def check(self, file: WorldFile) -> None:
        """Check that the member can be profiled. Raises MisuseError."""
        if not self.member:
            return
        known = {process.name: process for process in file.processes}
        if self.member not in known:
            hint = nearest(self.member, list(known), f"there are {', '.join(known)}")
            raise MisuseError(f"--profile-member: there is no process {self.member!r}{hint}")
        if known[self.member].command:
            raise MisuseError(
                f"--profile-member: {self.member} is a command; only members that run Python code"
                " in the launcher's processes can be profiled"
            )
        if importlib.util.find_spec("pyinstrument") is None:
            raise MisuseError(f"--profile-member needs pyinstrument: {install('profile')}")
        check_output(profile_path(file.world.name, self.member), "profile")


NOTHING: Final = Profiling()


def profile_path(world: str, member: str) -> Path:
    """The file for a member's profile, in the current folder."""
    return Path.cwd() / f"{world}-{member}.html"


def sampled(body: Callable[[], int], path: Path) -> int:
    """Run `body` under a sampling profiler and write its flame graph."""
    profiler: Any = importlib.import_module("pyinstrument").Profiler()
    profiler.start()
    try:
        return body()
    finally:
        profiler.stop()
        write_output(path, str(profiler.output_html()).encode(), "profile")
        print(f"profile written to {path}", flush=True)  # noqa: T201


# --- the operating system, and the context of a run ---


class Machine:
    """A clock, child processes by their ids, and pipes by their descriptors."""

    def monotonic(self) -> float:
        """Seconds of a monotonic clock."""
        return time.monotonic()

    def cores(self) -> int:
        """Number of cores for the processes of a world."""
        return machine_resources.cores()

    # --- pipes ---

    def pipes(self) -> Pipes:
        """A set of pipes to wait for."""
        return Pipes()

    lifeline = staticmethod(os.pipe)
    """A pipe that closes when the launcher dies."""

    close = staticmethod(os.close)
    """Close an end of a pipe."""

    def write(self, descriptor: int, data: bytes) -> None:
        """Write to a pipe. Raises OSError."""
        os.write(descriptor, data)

    # --- processes ---

    def start_coordinator(
        self, start: CoordinatorStart, lifeline: int
    ) -> tuple[ChildProcess, int, int]:
        """Start a coordinator; returns its process and the pipes for commands and reports."""
        command_read, command_write = os.pipe()
        report_read, report_write = os.pipe()
        child = child_processes.fork(
            lambda: run_coordinator(start, ReportPipe(report_write), command_read),
            (command_read, report_write),
            lifeline,
        )
        # The child has its own copies; with these open, the end of a pipe would not be detected.
        os.close(command_read)
        os.close(report_write)
        os.set_blocking(report_read, False)
        os.set_blocking(command_write, False)  # A stuck coordinator must not block the launcher.
        return child, command_write, report_read

    def start_member(self, start: MemberStart, lifeline: int) -> ChildProcess:
        """Start the process of members, or the command of its only one."""
        process = start.members[0]
        if process.command:
            environment = {
                "MINERVA_WORLD": start.world,
                "MINERVA_CONNECT": start.endpoint,
                "MINERVA_NAME": process.name,
            }
            return child_processes.command(process.command, environment, process.folder, lifeline)
        read, write = os.pipe()
        child = child_processes.fork(
            partial(run_member, start, ReportPipe(write)), (write,), lifeline
        )
        os.close(write)
        os.set_blocking(read, False)
        return replace(child, reports=read)

    signal = staticmethod(os.kill)

    def is_stopped(self, pid: int) -> bool:
        """Whether a process is stopped by a signal; False where /proc does not exist."""
        try:
            stat = Path(f"/proc/{pid}/stat").read_text()
        except OSError:
            return False
        # The name in brackets may contain anything; the state follows it.
        return stat.rpartition(")")[2].split()[:1] in (["T"], ["t"])

    kill = staticmethod(child_processes.kill)
    kill_group = staticmethod(child_processes.kill_group)
    next_ended = staticmethod(child_processes.next_ended)


def stopped_processes(pid: int) -> list[int]:
    """Those of a process and its children that a signal has stopped; empty without /proc."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        children = []
    return [each for each in (pid, *map(int, children)) if REAL.is_stopped(each)]


REAL: Final = Machine()


@dataclass(slots=True)
class LaunchContext:
    """One world, and the context that its processes share while it runs.

    `endpoint` is that for local processes ("": not known yet), and `shared` whether large messages
    use shared memory. `lifeline` is a pipe that closes when the launcher dies.
    """

    file: WorldFile
    profiling: Profiling
    machine: Machine = REAL
    pipes: Pipes = field(init=False)
    lifeline: tuple[int, int] = field(init=False)
    shared: bool = False
    endpoint: str = ""

    def __post_init__(self) -> None:
        self.pipes, self.lifeline = self.machine.pipes(), self.machine.lifeline()

    def close(self) -> None:
        """Close the pipes after all processes have ended."""
        self.pipes.close()
        for end in self.lifeline:
            self.machine.close(end)


# --- the table ---

HEALTHY_SECONDS: Final = 30.0
HEALTHY_FRAMES: Final = 10
"""Seconds and frames after which the failure count of a working process is reset."""

REPORT_SECONDS: Final = 0.4
"""Time for the last reports about a process, or about the end of the world, to arrive."""

STACK_SECONDS: Final = 0.5
STACK_GAP_SECONDS: Final = 0.2
"""Time to wait for the stacks of a process, and for each further line of them."""

MIN_RESTART_SECONDS: Final = 0.05
MAX_RESTART_SECONDS: Final = 5.0

STARTS_PER_CORE: Final = 4
"""More than one, because a process that waits for an answer leaves its core to others."""

SLOT_SECONDS: Final = 2.0
"""Time after which a starting process no longer prevents others from starting."""

IN_A_FRAME: Final = re.compile(r"failed in frame \d+: ")
"""Beginning of the report about an error that the same frame would cause again."""

FAILURE_REPORT: Final = re.compile(r"failed(?: in frame \d+)?: ")
"""Beginning of a member's report about an error in its user code."""

GONE: Final = re.compile(r"is gone\b")
"""Beginning of the coordinator's line about a member whose process has ended."""

MAX_LINE_LENGTH: Final = 2000


@fast_dataclass
class FailureCause:
    """Why a process ends: the report of a `member`; or that code blocks it, as logged before.

    `final`: another attempt would fail for the same reason.
    """

    member: str = ""
    text: str = ""
    blocked: str = ""
    final: bool = False


NO_CAUSE: Final = FailureCause()


@dataclass(slots=True)
class SupervisedProcess:
    """A process of the operating system with its state; times are of the monotonic clock.

    `members`: the processes of the world file that it runs, mostly one. `awaited`: names of those
    that have not joined. `restarting`: an operator requested a restart. `exited_at`: when an exit
    with code 0 counts as a failure unless the world has ended. `stacks`: lines of its stacks, None
    if they were not requested. `joined_at`, `joined_in`: time and frame of its last `hello`.
    `waited`: seconds that frames have waited for it.
    """

    members: tuple[ProcessSpec, ...]
    machine: Machine = REAL
    child: ChildProcess | None = None
    output: LineReader | None = None
    failures: int = 0
    joined_at: float | None = None
    joined_in: int = 0
    waited: float = 0.0
    restart_at: float | None = None
    exited_at: float | None = None
    cause: FailureCause = NO_CAUSE
    restarting: bool = False
    abandoned: bool = False
    stacks: list[str] | None = None
    awaited: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        self.awaited = frozenset(self.names)

    @property
    def spec(self) -> ProcessSpec:
        """The first member, whose restarts are those of all."""
        return self.members[0]

    @property
    def name(self) -> str:
        """The name of its only member, or of the process that services share."""
        return SERVICES if self.spec.shared else self.spec.name

    @property
    def names(self) -> list[str]:
        """The names of its members."""
        return [member.name for member in self.members]

    @property
    def due(self) -> list[float]:
        """The times at which the supervisor has to check it."""
        return [at for at in (self.restart_at, self.exited_at) if at is not None]

    def restart(self) -> None:
        """Restart it on request; this does not count as a failure."""
        self.restarting = self.child is not None
        if self.child is not None:
            self.machine.kill(self.child.pid)
        else:
            self.restart_at = self.machine.monotonic()

    def exited(self) -> None:
        """Note an exit with code 0: a report about the end of the world may follow."""
        self.exited_at = self.machine.monotonic() + REPORT_SECONDS

    def started(self, child: ChildProcess) -> None:
        """Note a start or restart."""
        self.child, self.restart_at, self.joined_at = child, None, None
        self.cause, self.waited, self.awaited = NO_CAUSE, 0.0, frozenset(self.names)

    def joined(self, member: str, frame: int) -> None:
        """Note the `hello` of a member."""
        self.awaited -= {member}
        if not self.awaited:
            self.joined_at, self.joined_in = self.machine.monotonic(), frame

    def was_healthy(self, now: float, frame: int) -> bool:
        """Whether it has worked for long enough; time that frames waited for it does not count.

        Frames count too: a process that hangs in each frame is waited for most of the time.
        """
        if self.joined_at is None:
            return False
        worked = now - self.joined_at - self.waited
        return worked > HEALTHY_SECONDS and self._has_worked(frame)

    def _has_worked(self, frame: int) -> bool:
        return self.joined_at is not None and frame - self.joined_in >= HEALTHY_FRAMES

    def fail(self, frame: int, *, killed: bool = False) -> float | None:
        """Count a failure; returns the seconds until its restart, None if there is none.

        A process that was `killed` in the middle of its work has not failed itself, so nothing is
        gained by a delay, for which others would wait.
        """
        now = self.machine.monotonic()
        if self.was_healthy(now, frame):
            self.failures = 0
        self.failures += 1
        self.exited_at = None
        if self.spec.on_failure != "restart" or self.failures > self.spec.restarts:
            return None
        delay = min(MAX_RESTART_SECONDS, MIN_RESTART_SECONDS * 2 ** (self.failures - 1))
        if killed and not self.waited and self._has_worked(frame):
            delay = 0.0
        self.restart_at = now + delay
        return delay


class ProcessTable:
    """All local processes of a world, by name and by member; `log` receives what they print.

    `on_report` receives what these processes report.
    """

    def __init__(
        self,
        context: LaunchContext,
        log: ProcessLog,
        on_report: Callable[[dict[str, Any]], None] = lambda report: None,
    ) -> None:
        self._context = context
        self._log = log
        self._on_report_line = on_reports(on_report)
        self._machine = context.machine
        self._processes = {
            name: SupervisedProcess(members, context.machine)
            for name, members in by_process(context.file.processes).items()
        }
        self._by_member = {name: process for process in self for name in process.names}
        self._reports: dict[str, LineReader] = {}
        self.queue = StartQueue(STARTS_PER_CORE * context.machine.cores())

    def __iter__(self) -> Iterator[SupervisedProcess]:
        return iter(self._processes.values())

    def __len__(self) -> int:
        return len(self._processes)

    @property
    def names(self) -> frozenset[str]:
        """The names of the members of all processes."""
        return frozenset(self._by_member)

    @property
    def queued(self) -> frozenset[str]:
        """The names of the members whose processes wait to be started."""
        queued = self.queue.queued
        return frozenset(n for n, process in self._by_member.items() if process.name in queued)

    @property
    def running(self) -> bool:
        """Whether any process runs."""
        return any(process.child for process in self)

    def get(self, name: str) -> SupervisedProcess | None:
        """The process of a member, or of this name; None if it is not a local one."""
        return self._by_member.get(name) or self._processes.get(name)

    def enqueue(self, process: SupervisedProcess) -> None:
        """Start or restart a process when it has a slot."""
        process.restart_at = None
        self.queue.add(process.name)

    def start_next(self) -> SupervisedProcess | None:
        """Start the next process that has a slot, and return it."""
        name = self.queue.next(self._machine.monotonic())
        if name is None:
            return None
        process, context = self._processes[name], self._context
        world, endpoint = context.file.world.name, context.endpoint
        start = MemberStart(
            name, process.members, world, endpoint, context.shared, context.profiling
        )
        # After a restart; a process that has not joined had nothing to forget.
        for line in forgotten(process.members) if process.joined_at is not None else ():
            self._log.add(name, line)
        child = self._machine.start_member(start, context.lifeline[0])
        process.started(child)
        process.output = LineReader(
            context.pipes, child.output, lambda line: self._read(process, line)
        )
        if child.reports != CLOSED:
            self._reports[name] = LineReader(context.pipes, child.reports, self._on_report_line)
        return process

    def _read(self, process: SupervisedProcess, line: str) -> None:
        stacks = process.stacks
        # An empty line separates the stacks of two threads; others are output of the process.
        separates = not line and stacks and is_stack(stacks[-1])
        if stacks is not None and (is_stack(line) or separates):
            stacks.append(line)
            return
        self._log.add(process.name, line, "info")

    def ended(self, pid: int) -> SupervisedProcess | None:
        """The process that has ended, after its last lines; kills what it has started."""
        for process in self:
            if process.child is not None and process.child.pid == pid:
                # Before the last lines are read: a grandchild that prints without end would supply
                # more forever.
                self._machine.kill_group(pid)
                if process.output is not None:
                    process.output.finish()
                if (reports := self._reports.pop(process.name, None)) is not None:
                    reports.finish()
                process.child = None
                self.queue.free(process.name)
                return process
        return None

    def kill(self) -> None:
        """Kill all processes and restart none."""
        self.queue.clear()
        for process in self:
            process.restart_at = process.exited_at = None
            if process.child is not None:
                self._machine.kill(process.child.pid)

    def give_up(self, process: SupervisedProcess, waited: float) -> None:
        """Kill a process that has not answered for `waited` seconds, which counts as a failure."""
        # Members of one process may be late together.
        if process.child is None or process.waited:
            return
        process.waited = waited
        self._log.failures.explained.update(process.names)
        # Before it is killed: this is the only trace of its activity.
        blocked = self._log.blocked(process.name, self.stacks(process), waited)
        process.cause = replace(process.cause, blocked=blocked)
        self._machine.kill(process.child.pid)

    def stacks(self, process: SupervisedProcess) -> list[str]:
        """The stacks of a process, written by itself; empty for a stopped process."""
        output = process.output
        # The child of a command only waits for it, so its stack contains no information.
        if process.child is None or output is None or process.spec.command:
            return []
        process.stacks = []
        self._machine.signal(process.child.pid, STACK_SIGNAL)
        until = self._machine.monotonic() + STACK_SECONDS
        # The caller may be the handler of another pipe. This reads one pipe without calling further
        # handlers, which could end the process in the meantime.
        while output.open and (left := until - self._machine.monotonic()) > 0:
            seconds = min(left, STACK_GAP_SECONDS) if process.stacks else left
            if not self._context.pipes.wait_for(output.descriptor, seconds):
                break
            output.read()
        return process.stacks


class StartQueue:
    """A queue of process names with a number of slots; times are monotonic seconds.

    A starting process needs a core for about 0.1 s. If hundreds start at once, each takes seconds
    and all of them exceed their time-outs. So each waits in the queue for a slot. It frees the slot
    when it has sent `hello`, when it has ended, or after SLOT_SECONDS: then it waits for something
    other than a core.
    """

    def __init__(self, slots: int) -> None:
        self._slots = slots
        # A dict is an ordered set here: a process that is added twice starts once.
        self._queue: dict[str, None] = {}
        self._started: dict[str, float] = {}

    @property
    def queued(self) -> frozenset[str]:
        """The names that wait for a slot."""
        return frozenset(self._queue)

    def add(self, name: str) -> None:
        """Add a process to the queue."""
        self._queue[name] = None

    def next(self, now: float) -> str | None:
        """Take the first process that has a slot; None if the queue is empty or all are busy."""
        busy = sum(since + SLOT_SECONDS > now for since in self._started.values())
        if not self._queue or busy >= self._slots:
            return None
        name = next(iter(self._queue))
        del self._queue[name]
        self._started[name] = now
        return name

    def free(self, name: str) -> None:
        """Free the slot of a process that has started or ended."""
        self._started.pop(name, None)

    def clear(self) -> None:
        """Remove all processes from the queue."""
        self._queue.clear()

    def next_at(self, now: float) -> float | None:
        """Time of the next slot that becomes free by time-out; None if no process waits for one."""
        if not self._queue:
            return None
        ends = [since + SLOT_SECONDS for since in self._started.values()]
        return min((end for end in ends if end > now), default=now)


class FailureLog:
    """The failures of user code in a run: the reports shown, and the causes.

    A process that is restarted several times would otherwise print the same report each time.
    `explained`: processes that have not joined again since the log named the reason for their end.
    """

    def __init__(self) -> None:
        self.explained: set[str] = set()
        self._shown: set[str] = set()
        self._before: set[tuple[str, str]] = set()

    def abbreviate(self, text: str) -> str:
        """A report without the lines that were shown before; empty if no line is new."""
        # The first line has the frame, so that the same error in another frame differs in it only.
        first, _, rest = text.partition("\n")
        seen, self._shown = self._shown, self._shown | {first, rest}
        if first in seen and rest in seen:
            return ""
        return f"{first} (as above)" if rest and rest in seen else text

    def is_new(self, place: str) -> bool:
        """Whether a line of code was not logged before; from now on it counts as logged."""
        known = place in self._shown
        self._shown.add(place)
        return not known

    def repeated(self, process: ProcessSpec, code: int, cause: str) -> bool:
        """Whether this process, or another host, has failed for the same cause before.

        The cause names the frame and the event: the same input fails again.
        """
        # A member in another language may end with any code after its report.
        if code <= 0 or code == RAISED_BY_CHANCE or not IN_A_FRAME.match(cause):
            return False
        key = ("" if process.agents else process.name, cause)
        repeated = key in self._before
        self._before.add(key)
        return repeated


class ProcessLog:
    """Logs lines about the processes of a world; `command` sends a command to its coordinator."""

    def __init__(self, world: str, console: Console, command: Callable[[str], None]) -> None:
        self._world = world
        self._console = console
        self._command = command
        self.failures = FailureLog()

    def note(self, text: str) -> None:
        """Show a line about the world, which is not kept."""
        self._console.note(f"{self._world}: {text}")

    def add(self, name: str, line: str, level: str = "warning") -> None:
        """Log a line about a process on the console and in the coordinator's log."""
        self._console.log(name, line, level)
        self.keep(name, line, level)

    def keep(self, name: str, text: str, level: str) -> None:
        """Log lines about a process in the coordinator's log only."""
        # A command to the coordinator is one line.
        for line in text.split("\n"):
            self._command(f"log {level} {name} {line[:MAX_LINE_LENGTH]}")

    def reported(self, name: str, text: str, details: str) -> None:
        """Show a line that the coordinator has logged about a member, unless it is known."""
        if name in self.failures.explained and GONE.match(text):
            return  # The reason and the line about its restart say more.
        if FAILURE_REPORT.match(text):
            text = self.failures.abbreviate(text)
        if text:
            self._console.log(name, text, "warning")
        self._console.details(name, details)

    def blocked(self, name: str, stacks: Sequence[str], waited: float) -> str:
        """Log that a process does not respond, with the line of user code that it executes.

        If this line was logged before, the line about the restart is enough; returns how it
        begins, otherwise an empty text. `waited`: seconds.
        """
        place, how = blocked_at(stacks, child_processes.__file__), ""
        if place is not None and not self.failures.is_new("\n".join(place.lines())):
            how = f"did not answer for {duration(waited)} (blocked as above)"
        else:
            text = f"no answer for {duration(waited)}: killing it"
            shown = [text] if place is None else [f"{text}; it is blocked in", *place.lines()]
            self.add(name, "\n".join(shown))
        if stacks:
            self._console.details(name, "\n".join(stacks))
            self.keep(name, "\n".join(stacks), "warning")
        return how
