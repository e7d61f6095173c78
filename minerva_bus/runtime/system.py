"""What a process on the bus has of the system that it runs on: clock, threads and sessions.

Coordinator and members take it as an argument, so that a simulation can give them another one,
in which time is a number and nothing runs by itself (`minerva_bus.testing.simulation`).
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Final, Protocol, TypeVar

import zenoh

from minerva_bus.runtime.diagnosis import obstacle
from minerva_bus.runtime.endpoints import check_endpoint
from minerva_bus.runtime.session import Secured, closed_in_time, open_client, open_hub
from minerva_bus.security.credentials import Credentials

DIAGNOSIS_SECONDS: Final = 2.0


Ended = TypeVar("Ended")


class Timer(Protocol):
    """Something that happens later, unless it is cancelled before."""

    def cancel(self) -> None:
        """Let it not happen, or not once more."""
        ...

    def join(self) -> None:
        """Wait until it is over."""
        ...


class System(Protocol):
    """A clock, threads and sessions; times are seconds."""

    def monotonic(self) -> float:
        """The time of a clock that never goes back."""
        ...

    def time(self) -> float:
        """The time since 1970."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        ...

    def later(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call once after some time, from a thread of its own."""
        ...

    def every(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call again and again, from a thread of its own."""
        ...

    def aside(self, call: Callable[[], object]) -> None:
        """Call now, from a thread of its own."""
        ...

    def open_hub(
        self,
        name: str,
        listen: str,
        *,
        shared: bool = False,
        secured: Secured | None = None,
        routers: Sequence[str] = (),
    ) -> tuple[zenoh.Session, str]:
        """A coordinator's session and where it listens; see `session.open_hub`."""
        ...

    def client(
        self, name: str, endpoint: str, *, shared: bool, own: Credentials | None
    ) -> AbstractContextManager[zenoh.Session]:
        """A member's session, which is closed in the end; see `session.open_client`."""
        ...

    def obstacle(self, endpoint: str, own: Credentials | None) -> str:
        """What is in the way to an endpoint; may take its time."""
        ...


class RealSystem:
    """The operating system, and Zenoh."""

    def monotonic(self) -> float:
        """The time of a clock that never goes back."""
        return time.monotonic()

    def time(self) -> float:
        """The time since 1970."""
        return time.time()

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        time.sleep(seconds)

    def later(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call once after some time, from a thread of its own."""
        timer = threading.Timer(seconds, call)
        timer.daemon = True
        timer.start()
        return timer

    def every(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call again and again, from a thread of its own."""
        return _Repeated(seconds, call)

    def aside(self, call: Callable[[], object]) -> None:
        """Call now, from a thread of its own."""
        threading.Thread(target=call, daemon=True).start()

    def open_hub(
        self,
        name: str,
        listen: str,
        *,
        shared: bool = False,
        secured: Secured | None = None,
        routers: Sequence[str] = (),
    ) -> tuple[zenoh.Session, str]:
        """A coordinator's session and where it listens. Raises BusError."""
        return open_hub(name, listen, shared=shared, secured=secured, routers=routers)

    @contextmanager
    def client(
        self, name: str, endpoint: str, *, shared: bool, own: Credentials | None
    ) -> Generator[zenoh.Session]:
        """A member's session, which is closed in the end. Raises BusError."""
        session = open_client(name, endpoint, shared=shared, own=own)
        with closed_in_time(session):
            yield session

    def obstacle(self, endpoint: str, own: Credentials | None) -> str:
        """What is in the way to an endpoint, looked for as long as DIAGNOSIS_SECONDS."""
        return obstacle(check_endpoint(endpoint), own, DIAGNOSIS_SECONDS)


class _Repeated:
    """A thread that calls every so many seconds."""

    def __init__(self, seconds: float, call: Callable[[], object]) -> None:
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(seconds, call), daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        self._stop.set()

    def join(self) -> None:
        self._thread.join()

    def _run(self, seconds: float, call: Callable[[], object]) -> None:
        while not self._stop.wait(seconds):
            call()


REAL: Final = RealSystem()


def run_through(life: Generator[None, None, Ended]) -> Ended:
    """Take one turn after another; what the last one returns."""
    try:
        while True:
            next(life)
    except StopIteration as end:
        return end.value
    finally:
        life.close()
