"""Rights of generators to send events in the name of agents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.events import AnyEvent, Events
from minerva_bus.grammar.ids import Ids

ID: Final = "#"
"""Prefix of an entry of `speaks_for` that is the id of an agent, not a kind."""


@dataclass(frozen=True, slots=True)
class SenderRights:
    """The senders that generators may use.

    `speaks_for`: by member, the kinds of agents and the `#id`s of agents in whose name it may send
    events. Any other member only sends events without a sender.
    """

    speaks_for: Mapping[str, tuple[str, ...]]
    composition: Composition

    def objection(self, member: str, events: Sequence[AnyEvent]) -> str:
        """Reason why a member may not send these events, or an empty string.

        Events from agents that are no longer in the string do not count as a violation of a member
        with such rights, because an agent may just have died: `kept` drops these events.
        """
        allowed = self.speaks_for.get(member, ())
        for event in events:
            senders = _senders(event)
            if senders is None:
                continue
            wrong = ~self._may(senders, allowed)
            if allowed:
                # Only existing agents that the member may not represent are a violation.
                wrong &= self.composition.kinds(senders) != ""
            if wrong.any():
                sender = senders[int(np.argmax(wrong))]
                whom = f"only for {', '.join(allowed)}" if allowed else "only for itself"
                return (
                    f"it sent {event.type} from #{sender[:64]}, but it speaks {whom};"
                    f" speaks_for under [process.{member}] names others"
                )
        return ""

    def kept(self, member: str, events: Sequence[AnyEvent]) -> list[AnyEvent]:
        """The events without sender, or whose sender is an agent that the member may represent."""
        allowed, kept = self.speaks_for.get(member, ()), list[AnyEvent]()
        for event in events:
            senders = _senders(event)
            rows = None if senders is None else self._may(senders, allowed)
            if rows is None or rows.all():
                kept.append(event)
            elif isinstance(event, Events) and rows.any():
                kept.append(event.take(np.flatnonzero(rows)))
        return kept

    def _may(self, senders: Ids, allowed: Sequence[str]) -> NDArray[np.bool_]:
        kinds = self.composition.kinds(senders)
        # A sender outside of the string has an empty kind, which no entry names.
        may = np.isin(kinds, [name for name in allowed if not name.startswith(ID)])
        ids = [name.removeprefix(ID) for name in allowed if name.startswith(ID)]
        if ids:
            may |= (Ids.of(ids).rows_of(senders) >= 0) & (kinds != "")
        return may


def _senders(event: AnyEvent) -> Ids | None:
    if isinstance(event, Events):
        return event.senders
    return Ids.of([event.sender]) if event.sender else None
