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

    def generate(self, tick: Tick) -> Iterator[Event]:
        yield eStep(self.count)
