"""Threads of a member besides the main thread, and the items that they put into its inbox."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.errors import MinervaError, UserCodeError
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.runtime.system import System, Timer
from minerva_bus.source import handler_name
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Generator, Service

MAX_WAITING: Final = 256
"""Most events and readings of a free-running generator that may wait for the main thread."""

POLL_SECONDS: Final = 0.2
"""Interval in seconds at which a blocked generator checks whether the member stops."""

FIGURES_SECONDS: Final = 1.0
"""Interval in seconds between two reports of a member's metrics."""


@dataclass(frozen=True, slots=True)
class Leave:
    """Request: the member leaves its world."""


@dataclass(frozen=True, slots=True)
class Published:
    """A reading of a free-running publisher."""

    topic: str
    reading: Reading


@dataclass(frozen=True, slots=True)
class ReportFigures:
    """Timer: send the member's metrics."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """Timer: call the service's `pulse`."""


class Outlet:
    """Passes events and readings of a free-running generator to the member's main thread."""

    def __init__(self, put: Callable[[Any], None], stop: threading.Event) -> None:
        self._put = put
        self._stop = stop
        self._room = threading.Semaphore(MAX_WAITING)

    def __call__(self, event: AnyEvent) -> None:
        """Emit an event."""
        self._add(event)

    def publish(self, topic: str, reading: Reading) -> None:
        """Publish a reading on a sensor topic."""
        self._add(Published(topic, reading))

    def taken(self) -> None:
        """The main thread has processed one item."""
        self._room.release()

    def _add(self, item: Any) -> None:
        # A generator that is faster than the bus blocks here; otherwise memory would fill up.
        while not self._room.acquire(timeout=POLL_SECONDS):
            # Otherwise a generator's thread would block forever after the end.
            if self._stop.is_set():
                return
        self._put(item)


class OwnThreads:
    """Threads and timers of a service: free-running generation, metrics and pulses.

    `put` adds items to the inbox of the member `name`. With `ends`, a service whose generation has
    finished leaves the world, which `notify` reports.
    """

    def __init__(
        self,
        name: str,
        put: Callable[[Any], None],
        notify: Callable[[str], None],
        system: System,
        *,
        ends: bool,
    ) -> None:
        self._system = system
        self._timers: list[Timer] = []
        self._name = name
        self._put = put
        self._notify = notify
        self._ends = ends
        self._stop = threading.Event()
        self._pulse_pending = threading.Event()
        self.outlet = Outlet(put, self._stop)

    def start(self, service: Service | None) -> None:
        """Start the threads of a service that has joined a world."""
        if service is None:
            return
        # A thread, because the code of a free-running generator may block, for example on a device.
        if isinstance(service, Generator) and not service.lockstep:
            self._system.aside(lambda: self._generate(service))
        report = ReportFigures()
        self._timers.append(self._system.every(FIGURES_SECONDS, lambda: self._put(report)))
        if service.pulse_every > 0:
            self._timers.append(self._system.every(service.pulse_every, self._add_pulse))

    def stop(self) -> None:
        """Request that all threads stop."""
        self._stop.set()
        for timer in self._timers:
            timer.cancel()

    def pulsed(self) -> None:
        """The main thread has processed a pulse: the next one may be added."""
        self._pulse_pending.clear()

    def _generate(self, service: Generator) -> None:
        try:
            service.run(self.outlet, self._stop)
            if self._ends and not self._stop.is_set():
                self._notify(f"{self._name}: no more events; leaving the world")
                # The last figures are sent before the member leaves.
                self._put(ReportFigures())
                self._put(Leave())
        except MinervaError as error:
            self._put(MinervaError(f"{self._name} cannot continue: {error}"))
        # Raised in the main thread, which reports failures. SystemExit would end only this thread,
        # and so would a KeyboardInterrupt, which no signal raises here.
        except BaseException as error:
            failure = UserCodeError(handler_name(service.run), service.run)
            failure.__cause__ = error
            self._put(failure)

    def _add_pulse(self) -> None:
        # Pulses do not queue up behind a slow one.
        if not self._pulse_pending.is_set():
            self._pulse_pending.set()
            self._put(Pulse())
