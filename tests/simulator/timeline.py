"""Simulated time: scheduled calls in order."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from random import Random
from typing import Final

EPOCH: Final = 1_700_000_000.0
"""Initial time of the simulated clock, seconds since 1970."""


@dataclass(slots=True)
class Alarm:
    """A scheduled call that can be cancelled."""

    call: Callable[[], object] | None

    def cancel(self) -> None:
        """Cancel the call."""
        self.call = None

    def join(self) -> None:
        """Return at once: there are no threads."""


class Timeline:
    """A clock that advances from call to call; calls at equal times keep their order.

    Random streams are keyed by the seed and a name, so that the draws of one do not
    depend on the others: shortening a history changes nothing else.
    """

    def __init__(self, seed: str) -> None:
        self.now = 0.0
        self.trace: list[str] = []
        self._seed = seed
        self._heap: list[tuple[float, int, Alarm]] = []
        self._numbers = count()
        self._streams: dict[str, Random] = {}

    def stream(self, name: str) -> Random:
        """The random stream of this name."""
        stream = self._streams.get(name)
        if stream is None:
            stream = self._streams[name] = Random(f"{self._seed}/{name}")
        return stream

    def at(self, time: float, call: Callable[[], object]) -> Alarm:
        """Schedule a call at a time, or now if it has passed."""
        alarm = Alarm(call)
        # The number orders calls at equal times, and alarms need no comparison.
        heapq.heappush(self._heap, (max(time, self.now), next(self._numbers), alarm))
        return alarm

    def after(self, seconds: float, call: Callable[[], object]) -> Alarm:
        """Schedule a call after some time."""
        return self.at(self.now + seconds, call)

    def run(self, until: float, over: Callable[[], bool]) -> None:
        """Execute calls in order, up to a time or until the end."""
        while self._heap and self._heap[0][0] <= until and not over():
            time, _, alarm = heapq.heappop(self._heap)
            # Taken out, so that cancelling a call that has happened has no effect.
            call, alarm.call = alarm.call, None
            self.now = time
            if call is not None:
                call()
        if not over():
            # The clock reaches the requested time even without calls.
            self.now = max(self.now, until)

    def note(self, who: str, text: str) -> None:
        """Write a line of the trace."""
        self.trace.append(f"{self.now:11.6f} {who}: {text}")
