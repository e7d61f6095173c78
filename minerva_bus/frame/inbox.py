"""Input for later frames: events by source."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeAlias

from minerva_bus.frame.checkpoint import Checkpoint
from minerva_bus.frame.event_sources import AGENTS, is_people, person_of, source_of
from minerva_bus.frame.unknown_receivers import UnknownReceivers
from minerva_bus.frame.work import EventWork, are_light
from minerva_bus.grammar.events import AnyEvent, Event
from minerva_bus.grammar.scene import Scene
from minerva_bus.world.norms import SOURCE

OrdersBySource: TypeAlias = Mapping[str, Sequence[AnyEvent]]
"""People's orders by source."""

MAX_WAITING: Final = 100_000
"""Maximum events of one free-running generator in the queue, which grows while a world pauses."""


def counting(source: str, event: AnyEvent) -> str:
    """What an order of a person, or a batch of orders, does in a frame, for the log."""
    if isinstance(event, Event):
        return f"{event} of {person_of(source)} counts"
    return f"{event.count} {event.type} of {person_of(source)} count"


def _receivers(event: AnyEvent) -> list[str]:
    return list(event.receivers or ())


class FrameInbox:
    """Events that wait for the next frame, by source.

    `emitted`: events that agents have sent. `sanctions`: events from norms. `sent`: both, by
    source, as the last complete frame left them. `unknown` finds events for agents that have never
    been in the string; `work` weighs events when they arrive.
    """

    def __init__(self, past: Checkpoint, scene: Scene, work: EventWork) -> None:
        """`past` and `scene` are the state with which the world begins."""
        self.work = work
        self.events: dict[str, list[AnyEvent]] = {
            source: list(events) for source, events in past.inbox.items()
        }
        self.sanctions: list[AnyEvent] = self.events.pop(SOURCE, [])
        self.emitted: list[AnyEvent] = list(past.emitted)
        self.sent: Mapping[str, Sequence[AnyEvent]] = past.sent
        self.max_waiting: int = MAX_WAITING
        self.unknown = UnknownReceivers(scene)
        self._counts: dict[str, int] = {}

    def __bool__(self) -> bool:
        return bool(self.events or self.emitted or self.sanctions)

    def waiting(self) -> dict[str, tuple[AnyEvent, ...]]:
        """Events for the next frame by source, for a checkpoint."""
        waiting = {source: tuple(events) for source, events in self.events.items()}
        return {**waiting, SOURCE: tuple(self.sanctions)} if self.sanctions else waiting

    def end_frame(self, emitted: list[AnyEvent]) -> None:
        """Queue the events that agents sent in a frame that is complete."""
        self.emitted = emitted
        # A copy, because the next frame takes the sanctions before it is complete.
        self.sent = {AGENTS: emitted, SOURCE: tuple(self.sanctions)}

    def take_sanctions(self) -> list[AnyEvent]:
        """Remove and return the sanctions, sorted by receivers; those of one keep their order."""
        taken, self.sanctions = self.sanctions, []
        return sorted(taken, key=_receivers)

    def replace(self, events: Mapping[str, Sequence[AnyEvent]]) -> None:
        """Replace all waiting events by these."""
        self.events = {source: list(waiting) for source, waiting in events.items()}

    def add(self, source: str, events: Sequence[AnyEvent]) -> bool:
        """Add events of a generator, which count by their weight; False if its queue is full."""
        waiting = self.events.setdefault(source, [])
        # A running count, because adding up the queue for each message would take quadratic time.
        held = self._counts.get(source)
        if held is None:  # The first since the last frame, or since the world was resumed.
            held = sum(map(len, waiting))
        # Whole messages are accepted or dropped, so the limit may be exceeded by one message.
        if held >= self.max_waiting:
            return False
        count = max(sum(map(len, events)), sum(map(self.work.weight, events)))
        self._counts[source] = held + count
        waiting.extend(events)
        return True

    def add_order(self, event: AnyEvent, person: str) -> None:
        """Add an event, or a batch, from a person, which counts by its weight."""
        source = source_of(person)
        self.events.setdefault(source, []).append(event)
        self._counts[source] = self.ordered_by(person) + self.work.weight(event)

    def ordered_by(self, person: str) -> int:
        """The count of the orders of a person since the last frame."""
        return self._counts.get(source_of(person), 0)

    def take_orders(self, is_taken: Callable[[str], bool]) -> OrdersBySource:
        """Remove the orders whose event type a generator takes, and return them by source."""
        taken: dict[str, tuple[AnyEvent, ...]] = {}
        for source in sorted(filter(is_people, self.events)):
            orders = tuple([event for event in self.events[source] if is_taken(event.type)])
            if orders:
                taken[source] = orders
                left = [event for event in self.events.pop(source) if not is_taken(event.type)]
                self.events |= {source: left} if left else {}
        return taken

    def take(self, is_taken: Callable[[str], bool]) -> dict[str, list[AnyEvent]]:
        """Remove and return the events for this frame.

        Orders that a generator takes stay: they arrived after the request to it.
        """
        # The counts start again with the queues; held-back events are counted by the next `add`.
        taken, self.events, self._counts = self.events, {}, {}
        for source in sorted(filter(is_people, taken)):
            late = [event for event in taken[source] if is_taken(event.type)]
            if late:
                self.events[source] = late
                in_time = [event for event in taken.pop(source) if not is_taken(event.type)]
                taken |= {source: in_time} if in_time else {}
        return taken

    def hold_back(self) -> dict[str, list[AnyEvent]]:
        """Remove the events, by source, that exceed the limit of one frame."""
        later: dict[str, list[AnyEvent]] = {}
        work, most = self.work, self.work.most_of_generator
        for source, events in self.events.items():
            if is_people(source) or (len(events) <= most and are_light(events)):
                continue
            count = 0
            for taken, event in enumerate(events):
                count += work.weight(event)
                # The first one always counts: the string may have grown since it arrived.
                if count > most and taken:
                    later[source] = events[taken:]
                    self.events[source] = events[:taken]
                    break
        return later

    def put_back(self, later: Mapping[str, Sequence[AnyEvent]]) -> None:
        """Queue events that were held back, before those that arrived since."""
        for source, events in later.items():
            self.events[source] = [*events, *self.events.get(source, ())]
