"""A simulated process: it runs in turns, and has the clock and sessions of a `System`."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from minerva_bus.errors import MinervaError
from minerva_bus.runtime.session import Secured, System
from tests.simulator.timeline import EPOCH, Alarm, Timeline

if TYPE_CHECKING:
    from tests.simulator.network import Network

FAILED: Final = 70
KILLED: Final = -9
TURN: Final = 20e-6, 120e-6
"""Duration of a turn in seconds: minimum and maximum."""

THREAD: Final = 10e-6, 200e-6
"""Seconds until a thread has started: minimum and maximum."""


class SimulatedProcess:
    """Runs a `life` in turns until it ends or is killed; `exited` receives the exit code.

    A frozen process runs no turn, and its timers wait. `log` receives its output.
    """

    def __init__(
        self,
        name: str,
        timeline: Timeline,
        network: Network,
        exited: Callable[[int], None],
        log: Callable[[str], None],
    ) -> None:
        self.name = name
        self.alive = True
        self.frozen_until = 0.0
        self.timeline = timeline
        self.system = SimulatedSystem(self)
        self.network = network
        self._exited = exited
        self.log = log
        self.life: Generator[None, None, int] | None = None
        self._next: Alarm | None = None
        self._blocked = False
        self._wake_at = 0.0
        self.after_turn: Callable[[], None] | None = None
        self._chance = timeline.stream(f"turns of {name}")

    def start(self, make: Callable[[], Generator[None, None, int]]) -> None:
        """Start a life, which ends at once if its start fails."""

        def begin() -> None:
            if self.alive:
                self._guarded(lambda: self._begin(make))

        self.timeline.after(self._chance.uniform(1e-3, 8e-3), begin)

    def _begin(self, make: Callable[[], Generator[None, None, int]]) -> None:
        self.life = make()
        self.wake()

    # --- turns ---

    def block(self) -> None:
        """Wait for input without running turns."""
        self._blocked = True

    def nap(self, seconds: float) -> None:
        """Run no turn for some time."""
        self._wake_at = self.timeline.now + seconds

    def wake(self) -> None:
        """Run a turn because of new input."""
        self._blocked = False
        # At most one turn is pending: it handles all input that has arrived by then.
        if self._next is None and self.alive and self.life is not None:
            at = max(self.timeline.now, self._wake_at) + self._chance.uniform(*TURN)
            self._next = self.timeline.at(max(at, self.frozen_until), self._turn)

    def _turn(self) -> None:
        self._next = None
        if not self.alive:
            return
        if self.timeline.now < self.frozen_until:
            self.wake()
            return
        self._guarded(self._take_turn)

    def _take_turn(self) -> None:
        assert self.life is not None
        self._blocked = False
        try:
            next(self.life)
        except StopIteration as end:
            self._end(end.value)
        # `after_turn` undoes the writes of a killed process for any end of its turn.
        finally:
            if self.after_turn is not None:
                self.after_turn()
        # A life that is not blocked has more to do; otherwise the next input wakes it.
        if self.alive and not self._blocked:
            self.wake()

    def _guarded(self, call: Callable[[], None]) -> None:
        """End the process at an exception, as for a child of the launcher."""
        try:
            call()
        except MinervaError as error:
            self.log(str(error))
            self._end(1)
        except Exception as error:
            self.log(f"{type(error).__name__}: {error}")
            self._end(FAILED)

    def _end(self, code: int) -> None:
        if self.alive:
            self.alive = False
            self.network.gone(self)
            self._exited(code)

    # --- faults ---

    def kill(self) -> None:
        """End it at once; later effects are ignored."""
        if self.alive:
            # Its clean-up runs when the history is over, without effects.
            self.network.graveyard.append(self.life)
            self._end(KILLED)

    def freeze(self, seconds: float) -> None:
        """Freeze it for some time."""
        self.frozen_until = max(self.frozen_until, self.timeline.now + seconds)


class SimulatedSystem(System):
    """The clock, the timers and the sessions of one simulated process."""

    def __init__(self, process: SimulatedProcess) -> None:
        self._process = process
        self._timeline = process.timeline

    @property
    def lives(self) -> bool:
        """Whether the process is alive."""
        return self._process.alive

    def monotonic(self) -> float:
        """Simulated seconds."""
        return self._timeline.now

    def time(self) -> float:
        """Simulated seconds since 1970."""
        return EPOCH + self._timeline.now

    def sleep(self, seconds: float) -> None:
        """Run no turn for some time after this one."""
        self._process.nap(seconds)

    def later(self, seconds: float, call: Callable[[], object]) -> Alarm:
        """Call something once after some time."""
        return self._timeline.after(seconds, lambda: self.call(call))

    def every(self, seconds: float, call: Callable[[], object]) -> Repeated:
        """Call something at an interval."""
        return Repeated(self, seconds, call)

    def aside(self, call: Callable[[], object]) -> None:
        """Call something as in a thread; it runs to its end without a pause."""
        chance = self._timeline.stream(f"threads of {self._process.name}")
        self.later(chance.uniform(*THREAD), call)

    def call(self, call: Callable[[], object]) -> None:
        """Call something of this process now, or after it is unfrozen."""
        process = self._process
        if not process.alive:
            return
        if self._timeline.now < process.frozen_until:
            self._timeline.at(process.frozen_until, lambda: self.call(call))
            return
        call()

    def open_hub(
        self,
        name: str,
        listen: str,
        *,
        shared: bool = False,
        secured: Secured | None = None,
        routers: Sequence[str] = (),
    ) -> tuple[Any, str]:
        """Open the coordinator's session; return it with its endpoint."""
        return self._process.network.open_hub(self._process, listen)

    @contextmanager
    def client(self, name: str, endpoint: str, **_: Any) -> Generator[Any]:
        """Open a member's session."""
        session = self._process.network.open_client(self._process)
        try:
            yield session
        finally:
            session.close()

    def obstacle(self, endpoint: str, own: object) -> str:
        """Diagnose nothing."""
        return f"no answer at {endpoint}"


class Repeated:
    """A call that repeats at an interval until it is cancelled."""

    def __init__(self, system: SimulatedSystem, seconds: float, call: Callable[[], object]) -> None:
        self._system = system
        self._seconds = seconds
        self._call = call
        self._alarm = system.later(seconds, self._ring)

    def cancel(self) -> None:
        """Cancel further calls."""
        self._seconds = math.inf
        self._alarm.cancel()

    def join(self) -> None:
        """Return at once: there are no threads."""

    def _ring(self) -> None:
        self._call()
        if self._seconds < math.inf:
            self._alarm = self._system.later(self._seconds, self._ring)
