"""Shared by several models: the event that starts a step, and its generator."""

from __future__ import annotations

from collections.abc import Iterator

from minerva_bus import Event, EventType, Generator, Tick

eStep = EventType("eStep", count=int)
"""Every agent acts once; `count` is the number of agents."""


class Clock(Generator, events=("eStep",)):
    """Starts a step in every frame."""

    def __init__(self, count: int = 0) -> None:
        self.count = count
        self.quiet = False
        """Emits no steps if true, so that events in transit can arrive."""

    def generate(self, tick: Tick) -> Iterator[Event]:
        if not self.quiet:
            yield eStep(self.count)
