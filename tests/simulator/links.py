"""The link between a client and the hub; messages in one direction keep their order.

A link loses nothing while it is up. Messages in transit when it is cut are lost; those that a
process sent before it died are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from tests.simulator.process import SimulatedProcess
from tests.simulator.sessions import Session
from tests.simulator.timeline import Timeline

LATENCY: Final = 20e-6, 150e-6
SLOW: Final = 1e-3, 40e-3
"""Ranges of latency in seconds: usually, and while a scheduler or a network is busy."""

MIN_SECONDS: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Weather:
    """Quality of links: the share of slow messages."""

    slow: float = 0.02


@dataclass(slots=True)
class _Way:
    """One direction: the receiver, and when the last message arrives."""

    to: SimulatedProcess
    last: float = 0.0
    stalled_until: float = 0.0


class Link:
    """Link between a client's session and the hub's; `heard` are the client's subscriptions."""

    def __init__(self, timeline: Timeline, weather: Weather, client: Session, hub: Session) -> None:
        self.client = client
        self.hub = hub
        self.cut = False
        self.heard: dict[str, None] = {}
        self.listens: dict[str, bool] = {}
        self.tokens: list[str] = []
        self._timeline = timeline
        self._weather = weather
        self._up, self._down = _Way(hub.process), _Way(client.process)
        self._chance = timeline.stream(f"link of {client.process.name}")

    def hears(self, patterns: dict[str, None]) -> None:
        """Send the client's subscriptions to the hub."""
        self.heard.update(patterns)
        # The cache of matches is no longer valid.
        self.listens.clear()

    def up(self, call: Callable[[], None]) -> None:
        """Execute something at the hub when its message arrives."""
        self._send(self._up, call)

    def down(self, call: Callable[[], None]) -> None:
        """Execute something at the client when its message arrives."""
        self._send(self._down, call)

    def stall(self, seconds: float, *, up: bool, down: bool) -> None:
        """Delay all messages for some time."""
        for way, stalls in ((self._up, up), (self._down, down)):
            if stalls:
                way.stalled_until = self._timeline.now + seconds

    def _send(self, way: _Way, call: Callable[[], None]) -> None:
        slow = self._chance.random() < self._weather.slow
        latency = self._chance.uniform(*(SLOW if slow else LATENCY))
        at = max(
            self._timeline.now + latency, way.stalled_until + MIN_SECONDS, way.last + MIN_SECONDS
        )
        way.last = at
        self._timeline.at(at, lambda: self._arrive(way, call))

    def _arrive(self, way: _Way, call: Callable[[], None]) -> None:
        # Messages in transit on a cut link, or to a dead process, are lost.
        if self.cut or not way.to.alive:
            return
        later = max(way.stalled_until, way.to.frozen_until)
        if self._timeline.now < later:
            # Calls at equal times keep their order, so delayed messages do, too.
            self._timeline.at(later, lambda: self._arrive(way, call))
            return
        call()
