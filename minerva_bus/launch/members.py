"""The processes of a world file that the launcher starts, and how they are doing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from minerva_bus.launch.context import LaunchContext
from minerva_bus.launch.failures import Failures
from minerva_bus.launch.machine import REAL, Joining, Machine
from minerva_bus.launch.pipes import NOWHERE
from minerva_bus.launch.reports import Lines
from minerva_bus.launch.starters import Child
from minerva_bus.launch.starting import PER_CORE, Starting
from minerva_bus.launch.traces import ASK, is_stack
from minerva_bus.launch.worldfile import Process

CALM = 30.0
CALM_FRAMES = 10
"""Seconds and frames for which a process has to serve well until a failure is a first one again."""

LAST_WORDS = 0.4
STACKS_WITHIN, STACKS_GO_ON = 0.5, 0.05
"""Seconds to wait for the stacks of a process, which may print all the time; and for more lines."""

FIRST_WAIT, LONGEST_WAIT = 0.05, 5.0


@dataclass(slots=True)
class Watched:
    """One process of the world file and how it is doing; times are of the monotonic clock.

    `wanted`: a person wants it started anew. `left_at`: it has ended without a failure, and from
    then on that is one, if the world has not ended, too. `cause`: what it has said of its failure.
    `stacks`: lines of the stacks that it was asked for; None where it was not. `came_at` and
    `came_in`: when, and in which frame, it has said hello; `waited`: for how many seconds a frame
    has waited for it in vain.
    """

    process: Process
    machine: Machine = REAL
    child: Child | None = None
    failures: int = 0
    came_at: float | None = None
    came_in: int = 0
    waited: float = 0.0
    restart_at: float | None = None
    left_at: float | None = None
    cause: str = ""
    wanted: bool = False
    gave_up: bool = False
    stacks: list[str] | None = None
    lines: Lines = field(default_factory=Lines)

    @property
    def times(self) -> list[float]:
        """When there is something to be done about it."""
        return [at for at in (self.restart_at, self.left_at) if at is not None]

    def restart(self) -> None:
        """Let it be started anew, as somebody wants it; that is no failure of it."""
        self.wanted = self.child is not None
        if self.child is not None:
            self.machine.kill(self.child.pid)
        else:
            self.restart_at = self.machine.monotonic()

    def leave(self) -> None:
        """It has ended by itself: word of the world's end may follow."""
        self.left_at = self.machine.monotonic() + LAST_WORDS

    def begin(self, child: Child) -> None:
        """It is started, or started anew."""
        self.child, self.restart_at, self.came_at = child, None, None
        self.lines, self.cause, self.waited = Lines(), "", 0.0

    def come(self, frame: int) -> None:
        """It has said hello."""
        self.came_at, self.came_in = self.machine.monotonic(), frame

    def served_well(self, now: float, frame: int) -> bool:
        """Whether it took part for long enough; time in which a frame waited for it is none.

        Seconds alone would not do: one that stops in each frame that it is asked in only waits.
        """
        if self.came_at is None:
            return False
        return now - self.came_at - self.waited > CALM and frame - self.came_in >= CALM_FRAMES

    def fail(self, frame: int) -> float | None:
        """Count a failure; the seconds until it is started anew, or None where it is not."""
        now = self.machine.monotonic()
        if self.served_well(now, frame):
            self.failures = 0
        self.failures += 1
        self.left_at = None
        if self.process.on_failure != "restart" or self.failures > self.process.restarts:
            return None
        wait = min(LONGEST_WAIT, FIRST_WAIT * 2 ** (self.failures - 1))
        self.restart_at = now + wait
        return wait


class Members:
    """All processes of a world that are started here, by name; `printed` gets their lines."""

    def __init__(self, around: LaunchContext, printed: Callable[[str, str], None]) -> None:
        here = [process for process in around.file.processes if not process.elsewhere]
        self._around = around
        self._printed = printed
        self._machine = around.machine
        self._watched = {process.name: Watched(process, around.machine) for process in here}
        self.failures = Failures()
        self.starting = Starting(PER_CORE * around.machine.cores())

    def __iter__(self) -> Iterator[Watched]:
        return iter(self._watched.values())

    def __len__(self) -> int:
        return len(self._watched)

    @property
    def names(self) -> frozenset[str]:
        """All of their names."""
        return frozenset(self._watched)

    @property
    def running(self) -> bool:
        """Whether any of them is there."""
        return any(watched.child for watched in self)

    def get(self, name: str) -> Watched | None:
        """The one of this name, if it is started here."""
        return self._watched.get(name)

    def ask_to_start(self, watched: Watched) -> None:
        """Let a process be started, or started anew, when it is its turn."""
        watched.restart_at = None
        self.starting.add(watched.process.name)

    def start_next(self) -> Watched | None:
        """Start the process whose turn it is, and return it; None where it is nobody's turn."""
        name = self.starting.next(self._machine.monotonic())
        if name is None:
            return None
        watched = self._watched[name]
        child = self._child(watched.process)
        watched.begin(child)
        self._around.pipes.listen(child.output, lambda: self._hear(watched, child))
        return watched

    def _child(self, process: Process) -> Child:
        around = self._around
        name, shared = around.file.world.name, around.shared
        work = Joining(process, name, around.endpoint, shared, around.profiling)
        return self._machine.start_member(work, around.lifeline[0])

    def ended(self, pid: int) -> Watched | None:
        """The process whose child has ended, once its last lines are told and its own are dead."""
        for watched in self:
            if watched.child is not None and watched.child.pid == pid:
                self._machine.kill_rest(pid)
                self._drain(watched, watched.child)
                watched.child = None
                self.starting.over(watched.process.name)
                return watched
        return None

    def kill(self) -> None:
        """Kill them all, and start none anew."""
        self.starting.cancel()
        for watched in self:
            watched.restart_at = watched.left_at = None
            if watched.child is not None:
                self._machine.kill(watched.child.pid)

    def _hear(self, watched: Watched, child: Child) -> bool:
        """Tell the lines that have come; whether more may be there."""
        data = self._around.pipes.read(child.output)
        if data is None:
            child.output = NOWHERE
        for line in watched.lines.feed(data or b""):
            if watched.stacks is not None and is_stack(line):
                watched.stacks.append(line)
            else:
                self._printed(watched.process.name, line)
        return bool(data)

    def stacks(self, watched: Watched) -> list[str]:
        """Where the threads of a process are, as it writes it itself; nothing where it cannot."""
        child = watched.child
        if child is None or watched.process.command:
            return []
        watched.stacks = []
        self._machine.signal(child.pid, ASK)
        until = self._machine.monotonic() + STACKS_WITHIN
        while child.output != NOWHERE and (left := until - self._machine.monotonic()) > 0:
            seconds = min(left, STACKS_GO_ON) if watched.stacks else left
            if not self._around.pipes.wait_for(child.output, seconds):
                break
            self._hear(watched, child)
        return watched.stacks

    def _drain(self, watched: Watched, child: Child) -> None:
        """Tell what is left of its lines."""
        while child.output != NOWHERE and self._hear(watched, child):
            pass
        self._around.pipes.forget(child.output)
        rest = watched.lines.end()
        if rest:
            self._printed(watched.process.name, rest)
