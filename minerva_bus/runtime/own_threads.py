"""The threads of a member beside its main one: they knock, and its main thread acts."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from minerva_bus.errors import MinervaError, UserCodeError
from minerva_bus.frame.member import Unready
from minerva_bus.runtime.notices import Count, Leave, Outlet, Pulse
from minerva_bus.runtime.system import System, Timer
from minerva_bus.source import handler_name
from minerva_bus.world.services import Generator, Service

COUNTED_EVERY = 1.0


class OwnThreads:
    """What a service does by itself: it speaks, is counted and feels its pulse.

    All of it is `put` before the main thread; `name` is the member's. `ends`: a service that has
    said all there is to say leaves the world, which it will `tell`.
    """

    def __init__(
        self,
        name: str,
        put: Callable[[Any], None],
        tell: Callable[[str], None],
        system: System,
        *,
        ends: bool,
    ) -> None:
        self._system = system
        self._timers: list[Timer] = []
        self._name = name
        self._put = put
        self._tell = tell
        self._ends = ends
        self._stop = threading.Event()
        self._pulsed = threading.Event()
        self._outlet = Outlet(put, self._stop)

    def start(self, service: Service | None) -> None:
        """Begin, for as long as the service is in a world."""
        if service is None:
            return
        if isinstance(service, Generator) and not service.lockstep:
            self._system.aside(lambda: self._emit_all(service))
        self._timers.append(self._system.every(COUNTED_EVERY, lambda: self._put(Count())))
        if service.pulse_every > 0:
            self._timers.append(self._system.every(service.pulse_every, self._give_pulse))

    def stop(self) -> None:
        """Come to an end, each at its next turn."""
        self._stop.set()
        for timer in self._timers:
            timer.cancel()

    def taken(self) -> None:
        """One thing that the service has said is dealt with."""
        self._outlet.taken()

    def felt(self) -> None:
        """A pulse was felt: the next one may come."""
        self._pulsed.clear()

    def _emit_all(self, service: Generator) -> None:
        try:
            service.run(self._outlet, self._stop)
            if self._ends and not self._stop.is_set():
                self._tell(f"{self._name}: no more comes of it; it leaves the world")
                self._put(Count())
                self._put(Leave())
        except MinervaError as error:
            self._put(Unready(f"{self._name} cannot go on: {error}"))
        except (Exception, SystemExit) as error:
            failure = UserCodeError(handler_name(service.run), service.run)
            failure.__cause__ = error
            self._put(failure)

    def _give_pulse(self) -> None:
        """Knock, but not while a pulse still waits to be felt."""
        if not self._pulsed.is_set():
            self._pulsed.set()
            self._put(Pulse())
