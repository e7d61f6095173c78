"""People's events for the frames of regions, as a coordinator and its successors send them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from minerva_bus.frame.collection import HANDED_OVER, handed_over, is_handed_over, people_of
from minerva_bus.frame.inbox import FrameInbox, Orders, is_people, source_of
from minerva_bus.grammar.batch import AnyEvent


class RegionOrders:
    """The orders of each frame; `current` are those of the frame in progress.

    When a coordinator dies, only a part of the regions may have begun its last frame. So its
    successor repeats this frame with the same orders, which the journal marks as handed over, and
    those that arrive before it are for the next one.
    """

    def __init__(self, inbox: FrameInbox, *, succeeds: bool) -> None:
        self.current: Orders = {}
        self._inbox = inbox
        self._later: dict[str, list[AnyEvent]] = {}
        self._repeats = succeeds

    def add(self, event: AnyEvent, person: str) -> None:
        """Add an event from a person, for the next frame whose orders are not fixed."""
        waiting = self._later if self._repeats else self._inbox.events
        waiting.setdefault(source_of(person), []).append(event)

    def take(self) -> Orders:
        """The orders of the frame that begins, by source."""
        self.current = self._inbox.take_orders(lambda _: True)
        self._inbox.replace(self._later)
        self._later, self._repeats = {}, False
        return self.current

    def load(
        self, taken: Mapping[str, Sequence[AnyEvent]], waiting: Mapping[str, Sequence[AnyEvent]]
    ) -> None:
        """Continue with a frame of the journal: the events that count in it, and those after it."""
        self.current = {source: sent for source, sent in taken.items() if is_people(source)}
        self._inbox.replace(waiting)

    def noted(self, *, in_frame: bool) -> dict[str, Sequence[AnyEvent]]:
        """The events of people outside of all complete frames, for the journal."""
        fixed: Mapping[str, Sequence[AnyEvent]] = self.current if in_frame else self._inbox.events
        if not (in_frame or self._repeats):
            return {**self._inbox.events}
        waiting = self._inbox.events if in_frame else self._later
        if not (fixed or waiting):
            return {}
        handed = {handed_over(source): sent for source, sent in fixed.items()}
        # Also without any, because waiting events would count in this frame otherwise.
        return {HANDED_OVER: (), **handed, **waiting}

    def resume(self, noted: Mapping[str, Sequence[AnyEvent]]) -> None:
        """Continue with what a predecessor has noted."""
        if not any(map(is_handed_over, noted)):
            self._inbox.replace(noted)
            return
        fixed = {people_of(each): sent for each, sent in noted.items() if is_handed_over(each)}
        self._inbox.replace({source: sent for source, sent in fixed.items() if sent})
        self._later = {
            source: list(sent) for source, sent in noted.items() if not is_handed_over(source)
        }
