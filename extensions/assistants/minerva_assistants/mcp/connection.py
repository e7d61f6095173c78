"""The world that a server addresses: connected at the first use, and again after its end."""

from __future__ import annotations

import threading
from collections.abc import Callable

from minerva_bus.api.live import Live
from minerva_bus.grammar.vocabulary import Vocabulary


class WorldConnection:
    """A connection to a running world, for several threads.

    Args:
        connect: opens the connection; raises BusError if no such world runs.

    """

    def __init__(self, connect: Callable[[], Live]) -> None:
        self._connect = connect
        self._live: Live | None = None
        self._lock = threading.Lock()

    def live(self) -> Live:
        """The running world. Raises BusError if there is none."""
        with self._lock:
            # Another world of this name may run since.
            if self._live is not None and self._live.ended:
                self._live.close()
                self._live = None
            if self._live is None:
                self._live = self._connect()
            return self._live

    def vocabulary(self) -> Vocabulary:
        """The vocabulary of the running world. Raises BusError if there is none."""
        return self.live().vocabulary

    def close(self) -> None:
        """Disconnect; the world continues."""
        with self._lock:
            if self._live is not None:
                self._live.close()
                self._live = None
