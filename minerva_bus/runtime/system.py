"""Clock, threads and sessions of a process on the bus.

Coordinator and members take them as an argument. A simulation passes its own, in which time is a
variable and each step is scheduled (tests/simulator).
"""

# Zenoh's own stubs leave some types open.
# pyright: reportUnknownMemberType=false
from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import Final, Protocol, TypeVar

import zenoh

from minerva_bus.runtime.endpoints import check_endpoint, obstacle
from minerva_bus.runtime.session import Secured, closed_in_time, open_client, open_hub
from minerva_bus.security.credentials import Credentials

DIAGNOSIS_SECONDS: Final = 2.0


Ended = TypeVar("Ended")


class Timer(Protocol):
    """A pending call, or a repeated one."""

    def cancel(self) -> None:
        """Make no further call."""
        ...

    def join(self) -> None:
        """Wait until the last call has returned."""
        ...


class System:
    """A clock, threads and sessions, of the operating system and of Zenoh; times are in seconds."""

    def monotonic(self) -> float:
        """Monotonic time."""
        return time.monotonic()

    def time(self) -> float:
        """Time since 1970."""
        return time.time()

    def sleep(self, seconds: float) -> None:
        """Block the calling thread."""
        time.sleep(seconds)

    def later(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call once after a delay, in a thread."""
        timer = threading.Timer(seconds, call)
        # A pending timer must not delay the end of the process.
        timer.daemon = True
        timer.start()
        return timer

    def every(self, seconds: float, call: Callable[[], object]) -> Timer:
        """Call at intervals, in a thread."""
        return _Repeated(seconds, call)

    def aside(self, call: Callable[[], object]) -> None:
        """Call now, in a thread."""
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
        """A coordinator's session and its endpoint. Raises BusError."""
        return open_hub(name, listen, shared=shared, secured=secured, routers=routers)

    @contextmanager
    def client(
        self, name: str, endpoint: str, *, shared: bool, own: Credentials | None
    ) -> Generator[zenoh.Session]:
        """A member's session, as a context that closes it. Raises BusError."""
        session = open_client(name, endpoint, shared=shared, own=own)
        with closed_in_time(session):
            yield session

    def obstacle(self, endpoint: str, own: Credentials | None) -> str:
        """Reason why an endpoint is unreachable; blocks for DIAGNOSIS_SECONDS at most."""
        return obstacle(check_endpoint(endpoint), own, DIAGNOSIS_SECONDS)


class _Repeated:
    """A thread that calls at intervals."""

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


REAL: Final = System()


def run_through(life: Generator[None, None, Ended]) -> Ended:
    """Run all iterations of a process; returns its result."""
    try:
        while True:
            next(life)
    except StopIteration as end:
        return end.value
    finally:
        life.close()
