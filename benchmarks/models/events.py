"""What several models have in common: the event that begins a step, and who makes it."""

from __future__ import annotations

from collections.abc import Iterator

from minerva_bus import Event, EventType, Generator, Tick

eStep = EventType("eStep", count=int)
"""Every agent acts once; `count` is how many there are."""


class Clock(Generator, events=("eStep",)):
    """Calls a step in every frame."""

    def __init__(self, count: int = 0) -> None:
        self.count = count
        self.quiet = False
        """No step any more, so that what is under way may arrive."""

    def generate(self, tick: Tick) -> Iterator[Event]:
        if not self.quiet:
            yield eStep(self.count)
