"""Events from outside of all regions: of people, and of generators that run freely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, TypeAlias

from minerva_bus.frame.event_sources import (
    HANDED_OVER,
    handed_over,
    is_handed_over,
    is_people,
    people_of,
)
from minerva_bus.frame.inbox import FrameInbox
from minerva_bus.grammar.batch import AnyEvent

EventsBySource: TypeAlias = Mapping[str, Sequence[AnyEvent]]

_GENERATOR: Final = f"{HANDED_OVER}/"
"""Prefix of the names of generators whose events a journal marks as handed over to regions."""


class OutsideEvents:
    """The outside events of each frame, by source; `current` are those of the frame in progress.

    When a coordinator dies, only a part of the regions may have begun its last frame. So its
    successor repeats this frame with the same events, which the journal marks as handed over, and
    those that arrive before it are for the next one.

    Frames that are requested `ahead` have none, and a successor does not know which ones are. So it
    gives events to later ones only, except for those that are marked.
    """

    def __init__(self, inbox: FrameInbox, *, succeeds: bool, ahead: int = 0) -> None:
        self.current: EventsBySource = {}
        self._inbox = inbox
        self._ahead = ahead
        self._fixed: EventsBySource | None = None
        self._free_from: int = 0
        if succeeds:
            self._fix(inbox.events)

    def __bool__(self) -> bool:
        """Whether a frame has to be repeated with events."""
        return bool(self._fixed)

    def wait_for(self, frame: int) -> bool:
        """Whether there are events for a frame."""
        return frame >= self._free_from and bool(self._inbox.events)

    def take(self, frame: int) -> EventsBySource:
        """The events of the frame that begins, by source; too many of a generator wait."""
        if self._fixed is not None:
            self.current, self._fixed = self._fixed, None
            self._free_from = frame + self._ahead + 1
            return self.current
        if frame < self._free_from:
            return {}
        later = self._inbox.hold_back()
        self.current = self._inbox.take(lambda _: False)
        self._inbox.put_back(later)
        return self.current

    def load(self, taken: EventsBySource, waiting: EventsBySource) -> None:
        """Continue with a frame of the journal: the events that count in it, and those after it."""
        self.current = {name: sent for name, sent in taken.items() if not is_handed_over(name)}
        self._fix(waiting)

    def noted(self, *, in_frame: bool) -> dict[str, Sequence[AnyEvent]]:
        """The events outside of all complete frames, for the journal."""
        fixed, waiting = self.current if in_frame else self._fixed, self._inbox.events
        if fixed is None:
            return {**waiting}
        if not (fixed or waiting):
            return {}
        # Also without any, because waiting events would count in this frame otherwise.
        return {HANDED_OVER: (), **{_marked(name): sent for name, sent in fixed.items()}, **waiting}

    def resume(self, noted: EventsBySource) -> None:
        """Continue with what a predecessor has noted."""
        if not any(map(_is_marked, noted)):
            self._fix(noted)
            return
        marked = {_unmarked(name): sent for name, sent in noted.items() if _is_marked(name)}
        self._fixed = {name: tuple(sent) for name, sent in marked.items() if sent}
        self._inbox.replace({name: sent for name, sent in noted.items() if not _is_marked(name)})

    def _fix(self, events: EventsBySource) -> None:
        """Repeat the frame that begins with these events."""
        waiting = {name: tuple(sent) for name, sent in events.items()}
        self._fixed, later = ({}, waiting) if self._ahead else (waiting, {})
        self._inbox.replace(later)


def _marked(source: str) -> str:
    return handed_over(source) if is_people(source) else _GENERATOR + source


def _is_marked(source: str) -> bool:
    return is_handed_over(source) or source.startswith(_GENERATOR)


def _unmarked(marked: str) -> str:
    is_generator = marked.startswith(_GENERATOR)
    return marked.removeprefix(_GENERATOR) if is_generator else people_of(marked)
