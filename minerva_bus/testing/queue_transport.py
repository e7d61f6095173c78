"""The transport of the in-memory bus: a queue for each link, from which a schedule delivers."""

from __future__ import annotations

from collections import deque
from typing import Any, TypeAlias

from minerva_bus.frame import messages as m
from minerva_bus.frame.member import Member
from minerva_bus.runtime.direct import observers, receivers

Link: TypeAlias = tuple[str, str]
"""Kind of a link, and name of the member."""


class QueueTransport:
    """Queues every message until the schedule delivers it. `alive` are the running members."""

    def __init__(self) -> None:
        self.alive: dict[str, Member] = {}
        self.queues: dict[Link, deque[Any]] = {}

    def queue(self, kind: str, name: str) -> deque[Any]:
        """The queue of one link: "down", "up" or "there" (liveliness) of a member."""
        return self.queues.setdefault((kind, name), deque())

    def send(self, to: str, message: m.ToMember) -> tuple[()]:
        """Queue a message for the members that subscribe to it, whether or not they have joined."""
        for member in receivers(to, self.alive.values()):
            self.queue("down", member.name).append(message)
        return ()

    def show(self, event_type: str, message: m.ToMember, to: str) -> tuple[()]:
        """Queue a view for its observers."""
        for member in observers(event_type, self.alive.values()):
            self.queue("down", member.name).append(message)
        return ()

    def publish(self, readings: m.Readings) -> None:
        """Queue readings for the members that subscribe to their topic."""
        # Sorted, so that equal schedules give equal traces.
        for name, member in sorted(self.alive.items()):
            if readings.topic in member.topics:
                self.queue("down", name).append(readings)
