"""Runs the real launcher in turns on a simulated machine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from minerva_bus.launch.console import Console, RunSummary
from minerva_bus.launch.process_table import NOTHING
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.runtime.coordinator import Coordinator
from tests.simulator.links import Weather
from tests.simulator.machine import SimulatedMachine
from tests.simulator.network import Network
from tests.simulator.timeline import Alarm, Timeline

SOON: Final = 20e-6, 100e-6


class Quiet(Console):
    """A console that writes log lines to the trace."""

    def __init__(self, timeline: Timeline) -> None:
        super().__init__(quiet=True)
        self._timeline = timeline

    def log(self, name: str, line: str, level: str = "info") -> None:
        """Log a line about a member."""
        self._timeline.note(f"launcher ({name})", line.partition("\n")[0])

    def live(self, line: str) -> None:
        """Ignore the live line."""


class Launcher:
    """Runs a world on a simulated machine; `over` is set when all of its processes have ended."""

    def __init__(
        self,
        file: WorldFile,
        timeline: Timeline,
        weather: Weather,
        make: Callable[..., Coordinator],
    ) -> None:
        self.network = Network(timeline, weather)
        self.machine = SimulatedMachine(timeline, self.network, self._wake)
        self._supervisor = Supervisor(file, Quiet(timeline), 0.0, NOTHING, make, self.machine)
        self._timeline = timeline
        self._rng = timeline.stream("launcher")
        self._next: Alarm | None = None
        self._in_turn = False
        self.over = False

    @property
    def endpoint(self) -> str:
        """Endpoint for local processes; empty before the coordinator listens."""
        return self._supervisor.endpoint

    @property
    def failure(self) -> str:
        """Reason for a premature end of the world; otherwise empty."""
        return self._supervisor.failure

    def begin(self) -> None:
        """Start the world."""
        self._supervisor.start(
            lambda endpoint: None
        )  # Claims the name of the world; there is only one here.
        self._wake()

    def result(self) -> RunSummary:
        """The summary of the run."""
        return self._supervisor.summary()

    def _wake(self) -> None:
        # A turn in progress schedules the next one itself.
        if not self._in_turn and not self.over:
            self._at(self._timeline.now + self._rng.uniform(*SOON))

    def _at(self, time: float) -> None:
        if self._next is not None:
            self._next.cancel()
        self._next = self._timeline.at(time, self._take_turn)

    def _take_turn(self) -> None:
        self._next = None
        self._in_turn = True
        # The first wait of a turn is the idle time, which the timeline has spent already.
        self.machine.pipes().waits = False
        self._supervisor.turn()
        self._in_turn = False
        if not self._supervisor.busy:
            self.over = True
            self._supervisor.kill_all()
            return
        soon = self._rng.uniform(*SOON)
        waits = bool(self.machine.ended) or self.machine.pipes().readable()
        # As the real launcher: at once if there is news, otherwise at the next deadline.
        delay = soon if waits else max(soon, self._supervisor.patience())
        self._at(self._timeline.now + delay)
