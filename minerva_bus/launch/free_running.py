"""Services that run by the clock in an in-process run: free-running generators and pulses."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from queue import SimpleQueue
from typing import Any, Final

from minerva_bus.blame import blamed, report
from minerva_bus.errors import UserCodeError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.member import Member
from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.launch.printed import inherited
from minerva_bus.runtime.direct import InProcessRunner
from minerva_bus.runtime.own_threads import Outlet, Published
from minerva_bus.source import handler_name
from minerva_bus.world.services import Generator

MAX_WAITING: Final = 256
"""Most events and readings of a free-running generator that may wait for the main thread."""

POLL_SECONDS: Final = 0.2
"""Interval in seconds at which a blocked generator checks whether the world has ended."""


def close_services(members: Iterable[Member], log: Callable[[str, str], None]) -> None:
    """Close all services; logs by name of the member which of them fail.

    The world is over, so an error does not change its result: it is logged, as on the bus.
    """
    for member in members:
        if member.service is not None:
            try:
                with blamed(member.service.close):
                    member.service.close()
            except UserCodeError as error:
                log(member.name, report(error))


class WaitingOutput:
    """Output of a free-running generator that waits for the main thread."""

    def __init__(self, put: Callable[[Any], None], stop: threading.Event) -> None:
        self._put = put
        self._stop = stop
        self._room = threading.Semaphore(MAX_WAITING)

    def add(self, output: AnyEvent | Published) -> None:
        """Queue an event or a reading, from the generator's thread."""
        # A generator that is faster than the frames blocks here; otherwise memory would fill up.
        while not self._room.acquire(timeout=POLL_SECONDS):
            # Otherwise a generator's thread would block forever after the end.
            if self._stop.is_set():
                return
        self._put(output)

    def taken(self) -> None:
        """The main thread has processed one item."""
        self._room.release()


class FreeRunning:
    """Runs each free-running generator in a thread, and passes its output to the main thread.

    Frames run in the main thread only, so output waits in a queue until `deliver` is called.
    """

    def __init__(self, runner: InProcessRunner, members: Iterable[Member]) -> None:
        self._runner = runner
        self._members = tuple(members)
        self._queue: SimpleQueue[tuple[Member, Any]] = SimpleQueue()
        self._waiting: dict[str, WaitingOutput] = {}
        self._pulsed: dict[str, float] = {}
        self._stop = threading.Event()

    def start(self) -> None:
        """Start the threads."""
        for member in self._members:
            if isinstance(member.service, Generator) and not member.when.is_awaited:
                arguments = member, member.service
                generate = inherited(self._generate)
                threading.Thread(target=generate, args=arguments, daemon=True).start()

    def stop(self) -> None:
        """Request the end of all generators, without a join: their threads are daemons."""
        self._stop.set()

    def deliver(self) -> None:
        """Pass queued events and readings to the runner. Raises exceptions of generators."""
        for _ in range(self._queue.qsize()):  # Later output waits for the next turn.
            member, output = self._queue.get()
            # The report of an error names this member.
            self._runner.direct.running = member
            if isinstance(output, Exception):
                raise output
            if isinstance(output, Published):
                self._runner.publish(member.published(output.topic, output.reading))
            else:
                self._runner.handle(member.emitted(output))
            self._waiting[member.name].taken()

    def pulse(self) -> None:
        """Call `pulse` of the services that are due; a service that leaves ends the world."""
        now = time.monotonic()
        for member in self._members:
            service = member.service
            if service is None or not service.pulse_every:
                continue
            if now < self._pulsed.get(member.name, 0.0) + service.pulse_every:
                continue
            self._pulsed[member.name] = now
            if _call(service.pulse, service.leaves):
                self._runner.handle(s.End(f"{member.name} was closed"))

    def _generate(self, member: Member, service: Generator) -> None:
        try:
            waiting = WaitingOutput(lambda output: self._queue.put((member, output)), self._stop)
            self._waiting[member.name] = waiting
            # The main thread raises an error in `deliver`; in this thread it would be lost.
            service.run(Outlet(waiting.add), self._stop)
        except BaseException as error:
            failure = UserCodeError(handler_name(service.run), service.run)
            failure.__cause__ = error
            self._queue.put((member, failure))


def _call(pulse: Callable[[], object], leaves: Callable[[], bool]) -> bool:
    with blamed(pulse):
        pulse()
    with blamed(leaves):
        return leaves()
