"""Reports of agents to people: the latest event of an agent that no agent responds to."""

from __future__ import annotations

import re

from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.world.operator import WorldStatus
from minerva_services.geometry.colors import words

_SENDER = re.compile(r" from #(\S+)")
_TEXTS = re.compile(r'"((?:[^"\\]|\\.)*)"')


class LatestReport:
    """The latest report in a world's log, such as `r1 reached: kitchen (31.2 s)`."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        responded = frozenset[str]().union(*(k.subscribes for k in vocabulary.kinds.values()))
        self._types = {
            name
            for name, event_type in vocabulary.events.items()
            if not event_type.visual and name not in responded
        }
        self.text = ""
        self.last = 0
        """Number of the latest log entry, from which to ask for further ones."""

    def update(self, status: WorldStatus) -> None:
        """Take the log entries of a status."""
        for entry in status.happenings:
            if entry.number <= self.last:
                continue
            self.last = entry.number
            sender = _SENDER.search(entry.text)
            # Events without a sender are observations, for example of physics.
            if entry.about in self._types and sender is not None:
                self.text = _line(sender[1], entry.about, entry.text, entry.frame * status.dt)


def _line(sender: str, event_type: str, text: str, time: float) -> str:
    data = ", ".join(_TEXTS.findall(text))
    return f"{sender} {words(event_type)}{f': {data}' if data else ''} ({time:.1f} s)"
