"""Threads of a member besides the main thread, and the items that they put into its inbox."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.errors import MinervaError, UserCodeError
from minerva_bus.frame.member import Member
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.runtime.system import System, Timer
from minerva_bus.user_code import handler_name
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import Generator

STOP_SECONDS: Final = 1.0
"""Seconds that the end of a member waits for a message that another thread sends."""

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
    """Accepts the events and readings of a free-running generator, in the generator's thread."""

    def __init__(self, deliver: Callable[[AnyEvent | Published], None]) -> None:
        self._deliver = deliver

    def __call__(self, event: AnyEvent) -> None:
        """Emit an event."""
        self._deliver(event)

    def publish(self, topic: str, reading: Reading) -> None:
        """Publish a reading on a sensor topic."""
        self._deliver(Published(topic, reading))


class OwnThreads:
    """Threads and timers of a service: free-running generation, metrics and pulses.

    `put` adds items to the inbox of the member `name`. `send` sends an event or a reading at once,
    in the generator's thread: the main thread would take it only after another wake-up. With
    `ends`, a service whose generation has finished leaves the world, which `notify` reports.
    """

    def __init__(
        self,
        name: str,
        put: Callable[[Any], None],
        send: Callable[[AnyEvent | Published], None],
        notify: Callable[[str], None],
        system: System,
        *,
        ends: bool,
    ) -> None:
        self._system = system
        self._timers: list[Timer] = []
        self._name = name
        self._put = put
        self._send = send
        self._notify = notify
        self._ends = ends
        self._stop = threading.Event()
        self._sending = threading.Lock()
        self._pulse_pending = threading.Event()

    def start(self, member: Member) -> None:
        """Start the threads of a member's service after it has joined a world."""
        service = member.service
        if service is None:
            return
        # A thread, because the code of a free-running generator may block, for example on a device.
        if isinstance(service, Generator) and not member.when.is_awaited:
            self._system.aside(lambda: self._generate(service))
        report = ReportFigures()
        self._timers.append(self._system.every(FIGURES_SECONDS, lambda: self._put(report)))
        if service.pulse_every > 0:
            self._timers.append(self._system.every(service.pulse_every, self._add_pulse))

    def stop(self) -> None:
        """Request that all threads stop; from now on nothing is sent."""
        self._stop.set()
        for timer in self._timers:
            timer.cancel()
        # A thread that returns from Zenoh while the interpreter shuts down would abort the process.
        if self._sending.acquire(timeout=STOP_SECONDS):
            self._sending.release()

    def pulsed(self) -> None:
        """The main thread has processed a pulse: the next one may be added."""
        self._pulse_pending.clear()

    def _generate(self, service: Generator) -> None:
        try:
            service.run(Outlet(self._deliver), self._stop)
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

    def _deliver(self, output: AnyEvent | Published) -> None:
        try:
            with self._sending:
                if not self._stop.is_set():
                    self._send(output)
        # Raised in the main thread, which reports failures. A generator that catches exceptions
        # of its own code would hide it.
        except Exception as error:
            self._put(error)

    def _add_pulse(self) -> None:
        # Pulses do not queue up behind a slow one.
        if not self._pulse_pending.is_set():
            self._pulse_pending.set()
            self._put(Pulse())
