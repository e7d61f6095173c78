"""Which agent classes a process has, and which events concern whom."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from minerva_bus.errors import MisuseError, UserCodeError
from minerva_bus.grammar.batch import AnyEvent, Events
from minerva_bus.grammar.events import Event
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.source import handler_name
from minerva_bus.world.agent import Agent


class ActivityError(UserCodeError):
    """User code of an agent failed: its method, the agent, the event, the frame and the cause.

    `handler` is None where the agent's state was wrong before any method ran.
    """

    def __init__(
        self, handler: Callable[..., Any] | None, node: AgentNode, event: Event, frame: int
    ) -> None:
        shown = str(event)
        cut = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "…"
        what = "the state" if handler is None else handler_name(handler)
        super().__init__(f"{what} of {node.symbol}#{node.id} at {cut}", handler)
        self.event = shown
        self.frame = frame

    def __str__(self) -> str:
        where, _, cause = super().__str__().partition(self.where)
        return f"{where}{self.where} in frame {self.frame}{cause}"


_SHOWN = 200


Kinds = Mapping[str, type[Agent]]


def kinds_of(classes: Iterable[type[Agent]] | Kinds) -> Kinds:
    """Agent classes by the symbol of their kind. Raises MisuseError."""
    if isinstance(classes, Mapping):
        return cast("Kinds", classes)
    found: dict[str, type[Agent]] = {}
    for cls in classes:
        if not hasattr(cls, "kind"):
            raise MisuseError(
                f'{cls.__name__} has no symbol: class {cls.__name__}(Agent, symbol="A...")'
            )
        if found.setdefault(cls.kind.name, cls) is not cls:
            raise MisuseError(f"two classes have the symbol {cls.kind.name}")
    return found


@dataclass(slots=True)
class Addressed:
    """Events in order, found again by who they concern.

    An event's *place* in the order is a whole number; `event` gives the event back.
    """

    events: tuple[AnyEvent, ...]
    types: frozenset[str] = field(init=False)
    _everyone: dict[str, list[int]] = field(init=False)
    _someone: dict[str, list[int]] = field(init=False)
    _many: dict[str, list[int]] = field(init=False)

    def __post_init__(self) -> None:
        self.types = frozenset([event.type for event in self.events])
        self._everyone, self._someone, self._many = {}, {}, {}
        for index, event in enumerate(self.events):
            place = index << _ROW
            if isinstance(event, Events):
                if event.receivers is None:
                    places = range(place, place + event.count)
                    self._everyone.setdefault(event.type, []).extend(places)
                else:
                    self._many.setdefault(event.type, []).append(index)
                continue
            if not event.receivers:
                self._everyone.setdefault(event.type, []).append(place)
            for receiver in dict.fromkeys(event.receivers):
                self._someone.setdefault(receiver, []).append(place)

    def event(self, place: int) -> Event:
        """The event at a place."""
        item = self.events[place >> _ROW]
        if isinstance(item, Events):
            return item.event(place & ((1 << _ROW) - 1))
        return item

    def index(self, place: int) -> int:
        """Which of `events` is at a place."""
        return place >> _ROW

    def to(self, agent_id: str, event_types: Container[str]) -> list[Event]:
        """The events for one agent that responds to these types, in order."""
        return [self.event(place) for place in self.places(agent_id, event_types)]

    def places(self, agent_id: str, event_types: Container[str]) -> list[int]:
        """As `to`, but each event by its place."""
        found: list[int] = []
        for event_type, places in self._everyone.items():
            if event_type in event_types:
                found += places
        for place in self._someone.get(agent_id, ()):
            if self.events[place >> _ROW].type in event_types:
                found.append(place)
        for event_type, indexes in self._many.items():
            if event_type in event_types:
                for index in indexes:
                    rows = cast("Events", self.events[index]).rows_to(agent_id)
                    found += [(index << _ROW) + row for row in rows]
        found.sort()
        return found


_ROW = 32


def addressed(events: Sequence[AnyEvent] | Addressed) -> Addressed:
    """Events to be found by who they concern; worked out once for many strings."""
    return events if isinstance(events, Addressed) else Addressed(tuple(events))
