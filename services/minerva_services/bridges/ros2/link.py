"""A session that is opened and watched in its own thread, and reopened when lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import closing
from typing import Final

from minerva_services.bridges.ros2.network import Ros2Network
from minerva_services.bridges.ros2.session import Ros2Session
from minerva_services.bridging.bridge import SourceError, log

_RETRY_SECONDS: Final = 0.5
_CHECK_SECONDS: Final = 0.25


class NetworkLink:
    """Keeps a session open; calls `declare` for each new one and `beat` periodically.

    Logs one line when the network is lost and one when it is back.
    """

    def __init__(
        self,
        network: Ros2Network,
        node: str,
        declare: Callable[[Ros2Session], None],
        beat: Callable[[], None],
        seconds: float,
    ) -> None:
        self._network, self._node = network, node
        self._declare, self._beat, self._seconds = declare, beat, seconds
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.state = "not open yet"

    def start(self) -> None:
        """Start connecting."""
        self._thread.start()

    def wake(self) -> None:
        """Run the next beat immediately."""
        self._wake.set()

    def close(self) -> None:
        """Leave the network after the last beat."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(5.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                with closing(Ros2Session(self._network, self._node)) as session:
                    self._declare(session)
                    self._set_state(
                        "open", f"connected to the ROS 2 network at {self._network.router}"
                    )
                    self._watch(session)
                    # After closing, this last beat sends the stop.
                    self._beat()
            except SourceError as error:
                # After a loss the failed attempts are not logged again.
                if self.state != "lost":
                    self._set_state(str(error), f"{error}; retrying")
                self._stop.wait(_RETRY_SECONDS)

    def _watch(self, session: Ros2Session) -> None:
        """Beat until closed or disconnected."""
        looked = time.monotonic()
        while not self._stop.is_set():
            self._wake.wait(self._seconds)
            # Cleared before the beat: a wake-up during it causes another beat.
            self._wake.clear()
            self._beat()
            if time.monotonic() - looked < _CHECK_SECONDS:
                continue
            looked = time.monotonic()
            if not session.connected:
                where = f"the ROS 2 network at {self._network.router}"
                self._set_state("lost", f"{where} is lost; retrying")
                return

    def _set_state(self, state: str, line: str) -> None:
        if state != self.state:
            self.state = state
            log(line)
