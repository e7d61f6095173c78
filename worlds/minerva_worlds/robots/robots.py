"""Errands in the office: one per robot, in the first frames."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from minerva_agents.robot.vocabulary import eErrand
from minerva_bus import Event, Generator, Tick

ERRANDS: Final = {
    "r1": ("office", "library"),
    "r2": ("store", "kitchen"),
    "r3": ("workshop", "meeting"),
    "r4": ("library", "reception"),
}


class Dispatcher(Generator, events=("eErrand",)):
    """Sends each robot one errand.

    Args:
        every: frames between the orders of two robots, so that the first is out of the way.

    """

    def __init__(self, every: int = 30) -> None:
        self._every = every

    def generate(self, tick: Tick) -> Iterable[Event]:
        for number, (robot, (source, target)) in enumerate(ERRANDS.items()):
            if tick.number == number * self._every:
                yield eErrand(source, target, receivers=[robot])
