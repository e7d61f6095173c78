"""Who fetches what in the office: one errand for each robot, in its first frames."""

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
    """Tells each robot once what it is to bring where.

    Args:
        every: frames from one robot's order to the next one's, so that the first is out of the way.

    """

    def __init__(self, every: int = 30) -> None:
        self._every = every

    def generate(self, tick: Tick) -> Iterable[Event]:
        for number, (robot, (source, target)) in enumerate(ERRANDS.items()):
            if tick.number == number * self._every:
                yield eErrand(source, target, receivers=[robot])
