"""gDecide and gRepresent of Table 4: one event per frame."""

from __future__ import annotations

from collections.abc import Iterable

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.events import Event
from minerva_bus.world.services import Generator, Tick, WorldInfo
from minerva_services.event_factory import EventFactory


class Each(Generator):
    """Emits one event without data per frame, for all agents that respond to its type.

    Args:
        event: the event type.
        every: frames between events; the first is in frame 0.

    """

    def __init__(self, event: str, every: int = 1) -> None:
        if every < 1:
            raise MisuseError(f"each: every is {every}; expected an integer >= 1 (frames)")
        self._type = event
        if every > 1:
            self.when = f"each {every} frames"

    def generates(self) -> tuple[str, ...]:
        return (self._type,)

    def check(self, world: WorldInfo) -> None:
        self._event = EventFactory("each", world, self._type)()

    def generate(self, tick: Tick) -> Iterable[Event]:
        return (self._event,)
