"""Reports events for agents that have never been in the string, which nobody receives."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from itertools import islice
from typing import Final

from minerva_bus.errors import nearest
from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.events import AnyEvent, Events, first_of
from minerva_bus.grammar.scene import Scene

EVENTS: Final = "events"
"""The name under which they are logged."""

MAX_NAMES: Final = 10_000
"""Agents up to which an error compares their ids with an unknown one."""

MAX_RECEIVERS: Final = 1_000
"""Receivers of a batch that are compared with the string."""


def unknown_agent(composition: Composition, receiver: str, otherwise: str = "") -> str:
    """`#receiver`, shortened, with a hint; `otherwise` is one if no agent has a similar id."""
    known = sorted(islice(composition.agents(), MAX_NAMES))
    return f"#{receiver[:64]}{nearest(receiver, known, otherwise)}"


class UnknownReceivers:
    """The receivers of events that neither the string nor the first string `w` has.

    Agents die, and others cannot know it at once, so events for them are no mistake. The ids of
    newborns begin with those of their ancestors.
    """

    def __init__(self, w: Scene) -> None:
        self._w = w
        self._reported = set[str]()

    @cached_property
    def _first(self) -> Composition:
        return Composition(self._w)

    def problems(self, events: Iterable[AnyEvent], composition: Composition) -> Iterator[str]:
        """A line for each event type with such a receiver, once for each type."""
        single = dict[str, AnyEvent]()
        for event in events:
            if not event.receivers or event.type in self._reported:
                continue
            if isinstance(event, Events):
                first = event.receivers.take(slice(MAX_RECEIVERS))
                receiver = composition.first_missing(first)
                if receiver is not None:
                    single.setdefault(receiver, event)
            else:
                for receiver in event.receivers[:MAX_RECEIVERS]:
                    single.setdefault(receiver, event)
        known = composition.home_of_each(single) if single else {}
        for receiver in sorted(single.keys() - known.keys()):
            event = single[receiver]
            if event.type not in self._reported and not self._was_there(receiver):
                self._reported.add(event.type)
                by = _sender(event)
                whom = unknown_agent(composition, receiver)
                yield f"{event.type}{by} goes to an agent that the string does not have: {whom}"

    def _was_there(self, receiver: str) -> bool:
        parts = receiver.split(":")
        ancestors = [":".join(parts[:count]) for count in range(1, len(parts) + 1)]
        return bool(self._first.home_of_each(ancestors))


def _sender(event: AnyEvent) -> str:
    sender = first_of(event).sender
    return f" of #{sender}" if sender else ""
