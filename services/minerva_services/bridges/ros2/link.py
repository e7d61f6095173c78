"""A session that is opened in a thread of its own, watched, and opened anew where it was lost."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from typing import Final

from minerva_services.bridges.ros2.network import Network
from minerva_services.bridges.ros2.session import Session
from minerva_services.bridging import SourceError

_AGAIN: Final = 0.5
_GLANCE: Final = 0.25


class Link:
    """Keeps a session; `declare` is called with each new one, `beat` every so many seconds.

    Says in one line when the network is lost and when it is back.
    """

    def __init__(
        self,
        network: Network,
        node: str,
        declare: Callable[[Session], None],
        beat: Callable[[], None],
        seconds: float,
    ) -> None:
        self._network, self._node = network, node
        self._declare, self._beat, self._seconds = declare, beat, seconds
        self._stop = threading.Event()
        self._nudged = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.state = "not open yet"

    def start(self) -> None:
        """Begin to look for the network."""
        self._thread.start()

    def nudge(self) -> None:
        """Beat at once."""
        self._nudged.set()

    def close(self) -> None:
        """Leave the network; waits for the last beat."""
        self._stop.set()
        self._nudged.set()
        if self._thread.is_alive():
            self._thread.join(5.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                with closing(Session(self._network, self._node)) as session:
                    self._declare(session)
                    self._turn("open", f"the ROS 2 network at {self._network.router} is there")
                    self._watch(session)
                    self._beat()
            except SourceError as error:
                if self.state != "lost":
                    self._turn(str(error), f"{error}; tried again until it does")
                self._stop.wait(_AGAIN)

    def _watch(self, session: Session) -> None:
        """Beat until it is over, or the link has been lost."""
        looked = time.monotonic()
        while not self._stop.is_set():
            self._nudged.wait(self._seconds)
            self._nudged.clear()
            self._beat()
            if time.monotonic() - looked < _GLANCE:
                continue
            looked = time.monotonic()
            if not session.connected:
                where = f"the ROS 2 network at {self._network.router}"
                self._turn("lost", f"{where} is lost; tried again until it is there")
                return

    def _turn(self, state: str, line: str) -> None:
        if state != self.state:
            self.state = state
            say(line)


def say(line: str) -> None:
    """Tell people."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
