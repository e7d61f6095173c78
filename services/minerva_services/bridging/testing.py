"""Test support for bridges: runs one in a thread and collects its output."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType

from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.readings import Reading
from minerva_bus.world.services import WorldInfo
from minerva_services.bridging.bridge import Bridge

TIMEOUT_SECONDS = 20.0
POLL_SECONDS = 0.005
STOP_TIMEOUT_SECONDS = 10.0


class RunningBridge:
    """A bridge in its own thread, until the end of a `with` block.

        with RunningBridge(Anemometer("localhost:4001")) as running:
            (first,) = running.readings(1)

    A bridge that looks up event types needs a `world`, which it joins first.

    `published` has its readings with topics, `emitted` its events, `error` the exception it raised.
    """

    def __init__(self, bridge: Bridge, world: WorldInfo | None = None) -> None:
        self.bridge = bridge
        if world is not None:
            bridge.joined(world)
        self.published: list[tuple[str, Reading]] = []
        self.emitted: list[AnyEvent] = []
        self.error: Exception | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> RunningBridge:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join(STOP_TIMEOUT_SECONDS)
        # An error of the block must not be replaced by this one.
        if error is None and not self.ended():
            raise AssertionError(f"the bridge has not stopped within {STOP_TIMEOUT_SECONDS:.0f} s")

    def __call__(self, event: AnyEvent) -> None:
        """Collect an emitted event."""
        self.emitted.append(event)

    def publish(self, topic: str, reading: Reading) -> None:
        """Collect a published reading."""
        self.published.append((topic, reading))

    def ended(self) -> bool:
        """True if the thread has ended."""
        return not self._thread.is_alive()

    def counted(self, what: str) -> int:
        """How often the bridge has counted something."""
        value = self.bridge.report().get(what, 0)
        return value if isinstance(value, int) else 0

    @property
    def state(self) -> str:
        """State of its source: `open`, `ended`, or the reason of its failure."""
        return str(self.bridge.report()["source"])

    def wait_for(self, holds: Callable[[], object], what: str) -> None:
        """Wait for a condition. Raises AssertionError on time-out or if the bridge failed."""
        until = time.monotonic() + TIMEOUT_SECONDS
        while not holds():
            if self.error is not None:
                raise AssertionError(f"{what}: {self.error}") from self.error
            if time.monotonic() > until:
                raise AssertionError(
                    f"{what}: not within {TIMEOUT_SECONDS:.0f} s ({dict(self.bridge.report())})"
                )
            time.sleep(POLL_SECONDS)

    def readings(self, count: int, after: int = 0) -> list[Reading]:
        """`count` readings after the first `after`, as soon as they have arrived."""
        self.wait_for(lambda: len(self.published) >= after + count, f"{count} readings")
        return [reading for _, reading in self.published[after : after + count]]

    def _run(self) -> None:
        try:
            self.bridge.run(self, self._stop)
        except Exception as error:
            self.error = error
