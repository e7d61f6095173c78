"""For tests of bridges: one runs beside the test, and what it says is gathered."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType

from minerva_bus.grammar.batch import AnyEvent
from minerva_bus.world.readings import Reading
from minerva_services.bridging.bridge import Bridge

PATIENCE = 20.0
LOOKED_EVERY = 0.005
STOPS_WITHIN = 10.0


class Running:
    """A bridge in a thread of its own, until the end of a `with` block.

        with Running(Anemometer("localhost:4001")) as running:
            (first,) = running.readings(1)

    `published` has its readings with their topics, `emitted` its events, `error` what it raised.
    """

    def __init__(self, bridge: Bridge) -> None:
        self.bridge = bridge
        self.published: list[tuple[str, Reading]] = []
        self.emitted: list[AnyEvent] = []
        self.error: Exception | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Running:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join(STOPS_WITHIN)
        if error is None and not self.ended():
            raise AssertionError(f"the bridge has not stopped within {STOPS_WITHIN:.0f} s")

    def __call__(self, event: AnyEvent) -> None:
        """What the bridge emits."""
        self.emitted.append(event)

    def publish(self, topic: str, reading: Reading) -> None:
        """What the bridge publishes."""
        self.published.append((topic, reading))

    def ended(self) -> bool:
        """Whether it runs no more."""
        return not self._thread.is_alive()

    def counted(self, what: str) -> int:
        """How often it has counted something."""
        found = self.bridge.report().get(what, 0)
        return found if isinstance(found, int) else 0

    @property
    def state(self) -> str:
        """How its source is: `open`, `ended`, or what is the matter with it."""
        return str(self.bridge.report()["source"])

    def wait_for(self, holds: Callable[[], object], what: str) -> None:
        """Wait until it holds. Raises AssertionError where it does not, or the bridge failed."""
        until = time.monotonic() + PATIENCE
        while not holds():
            if self.error is not None:
                raise AssertionError(f"{what}: {self.error}") from self.error
            if time.monotonic() > until:
                raise AssertionError(
                    f"{what}: not within {PATIENCE:.0f} s ({dict(self.bridge.report())})"
                )
            time.sleep(LOOKED_EVERY)

    def readings(self, count: int, after: int = 0) -> list[Reading]:
        """So many readings behind the first `after` ones, as soon as they have come."""
        self.wait_for(lambda: len(self.published) >= after + count, f"{count} readings")
        return [reading for _, reading in self.published[after : after + count]]

    def _run(self) -> None:
        try:
            self.bridge.run(self, self._stop)
        except Exception as error:
            self.error = error
