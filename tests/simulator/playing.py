"""Plays a history: a world from its start to its end, with all its faults."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.frame.member_side import Member
from minerva_bus.launch.console import RunSummary
from minerva_bus.launch.process_specs import SERVICES
from minerva_bus.launch.run_outputs import journal_path
from minerva_bus.log.journal import read_journal, resume_from
from minerva_bus.runtime.coordinator import Coordinator
from minerva_bus.runtime.participants import Leave, MemberProcess
from tests.simulator.faults import Faults
from tests.simulator.history import History
from tests.simulator.launcher import Launcher
from tests.simulator.links import Weather
from tests.simulator.observing import Asked, Observed, observing
from tests.simulator.person import Person
from tests.simulator.process import SimulatedProcess
from tests.simulator.timeline import Timeline
from tests.simulator.worlds import GUESTS, NAME, world_file

MAX_SECONDS: Final = 400.0
"""Simulated seconds within which a world must have ended in spite of all faults."""

AFTERWARDS: Final = 15.0
"""Simulated seconds within which all processes of an ended world must have exited."""


@dataclass(frozen=True, slots=True)
class Played:
    """Result of a history; `waits` names the awaited members if it did not end.

    `failure` is the launcher's reason for ending the world, `left` the surviving processes,
    `listened` whether the world was ever reachable.
    """

    history: History
    observed: Observed
    result: RunSummary | None
    failure: str
    waits: str
    left: tuple[str, ...]
    trace: list[str]
    listened: bool

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.observed.frames)


class Play:
    """One history in progress; files go to a folder."""

    def __init__(self, history: History, folder: Path) -> None:
        self.history = history
        self.timeline = Timeline(str(history.seed))
        self.observed = Observed()
        self._begun: set[int] = set()
        self._coordinator: Coordinator | None = None
        shared = history.seed % 3 == 0
        self.file = world_file(
            history.frames,
            history.rate,
            folder,
            self.observed.shown,
            shared=shared,
            norms=history.norms,
            divided=history.divided,
        )
        self._sharing = {each.name for each in self.file.processes if each.shared}
        make = observing(self.timeline, self.observed, self._on_begin, self._on_end)
        self.launcher = Launcher(self.file, self.timeline, Weather(history.slow), make)
        self.network = self.launcher.network
        self.guests: dict[str, tuple[SimulatedProcess, MemberProcess]] = {}
        self._person = Person(self.timeline, self.network, history.acts, self._on_asked)
        self._faults = Faults(self)
        self._checked = history.seed % history.frames

    def run(self) -> Played:
        """Play it to its end."""
        # Faults of frame -1 count from the start of the world.
        self._faults.begin(-1)
        self.launcher.begin()
        self.timeline.run(MAX_SECONDS, lambda: self.launcher.over)
        over, waits, left = self.launcher.over, "", ()
        if over:
            self._person.leave()
            # Processes have this time to notice the end and to exit.
            self.timeline.run(self.timeline.now + AFTERWARDS, lambda: False)
            left = tuple(process.name for process in self._processes() if process.alive)
        else:
            waits = self._waits()
        result = self.launcher.result() if over else None
        self._bury()
        return Played(
            self.history,
            self.observed,
            result,
            self.launcher.failure,
            waits,
            left,
            self.timeline.trace,
            bool(self.launcher.endpoint),
        )

    # --- processes ---

    def process(self, name: str) -> SimulatedProcess | None:
        """The running process of a member."""
        name = SERVICES if name in self._sharing else name
        running = (process for process in self._processes() if process.alive)
        return next((process for process in running if process.name == name), None)

    def _processes(self) -> list[SimulatedProcess]:
        own = list(self.launcher.machine.processes.values())
        return [*own, *(process for process, _ in self.guests.values())]

    def attach(self, name: str) -> None:
        """Attach a guest, unless it is attached or there is no world."""
        if not self.launcher.endpoint or self.launcher.over:
            return
        if name in self.guests and self.guests[name][0].alive:
            return

        def log(line: str) -> None:
            self.timeline.note(name, line)

        def exited(code: int) -> None:
            self.timeline.note(name, f"ended with {code}")

        process = SimulatedProcess(name, self.timeline, self.network, exited, log)
        participant = Member(name, None, GUESTS[name])
        endpoint, system = self.launcher.endpoint, process.system
        member = MemberProcess([participant], NAME, endpoint, log, system=system)
        self.guests[name] = process, member
        process.start(member.life)

    def send_away(self, name: str) -> None:
        """Let a guest leave on its own initiative."""
        if name in self.guests and self.guests[name][0].alive:
            self.guests[name][1].inbox.put(Leave())

    # --- events of a run ---

    def _on_begin(self, frame: int) -> None:
        # A frame begins again under a successor; its faults have been executed already.
        if frame in self._begun:
            return
        self._begun.add(frame)
        self._faults.begin(frame)
        if frame == self.history.acts_from:
            self._person.begin()

    def _on_end(self, coordinator: Coordinator) -> None:
        self._coordinator = coordinator
        if coordinator.algorithm.frame == self._checked:
            self._check_journal(coordinator.algorithm)

    def _check_journal(self, algorithm: FrameAlgorithm) -> None:
        """Check that a successor from the journal has the same string."""
        past = read_journal(journal_path(self.file), self.file.world)
        if past is None:
            self.observed.problems.append(f"there is no journal in frame {algorithm.frame}")
            return
        again = FrameAlgorithm(past.world)
        resume_from(past, again, lambda _: None)
        if (again.frame, again.scene.digest) != (algorithm.frame, algorithm.scene.digest):
            self.observed.problems.append(
                f"the journal continues from frame {again.frame}, {again.scene.digest.hex()[:8]},"
                f" not {algorithm.frame}, {algorithm.scene.digest.hex()[:8]}"
            )

    def _on_asked(self, asked: Asked) -> None:
        self.observed.asked.append(asked)

    def _waits(self) -> str:
        coordinator = self._coordinator
        alive = ", ".join(process.name for process in self._processes() if process.alive)
        if coordinator is None:
            return f"no frame has ended; alive: {alive}"
        algorithm = coordinator.algorithm
        names = ", ".join(algorithm.waiting_for()) or "nobody"
        paused = ", paused" if coordinator.schedule.pace.paused else ""
        phase = algorithm.phase.value
        return f"frame {algorithm.frame} ({phase}{paused}) waits for {names}; alive: {alive}"

    def _bury(self) -> None:
        """Close the coroutines of killed processes without effects."""
        for process in self._processes():
            # Dead before their coroutines are closed: their `finally` blocks must have no effect.
            process.alive = False
        lives: list[Generator[None, None, int] | None] = list(self.network.graveyard)
        lives += [process.life for process in self._processes()]
        for life in lives:
            if life is not None:
                life.close()


def play(history: History, folder: Path) -> Played:
    """Play a history; its journal is written to an empty folder."""
    return Play(history, folder).run()
