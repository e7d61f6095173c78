"""gDecide and gRepresent of Table 4: one event each frame."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.event_factory import EventFactory


class Each(Generator):
    """Makes one event without data each frame, for everybody who responds to its type.

    Args:
        event: the event type.
        every: frames from one to the next; the first comes in frame 0.

    """

    def __init__(self, event: str, every: int = 1) -> None:
        if every < 1:
            raise MisuseError(f"each: every is {every}; expected a number of frames from 1")
        self._type = event
        self._every = every

    def generates(self) -> tuple[str, ...]:
        return (self._type,)

    def joined(self, world: WorldInfo) -> None:
        self._event = EventFactory("each", world, self._type)()

    def generate(self, tick: Tick) -> Iterable[Event]:
        return () if tick.number % self._every else (self._event,)
