"""Which processes start when: no more at once than the machine's cores can carry.

A process that starts needs a core for some milliseconds. Hundreds that start at once need seconds
each, and none of them answers in time. So each waits in a queue for a place, and leaves the place
when it has said hello, when it has ended, or when it takes long for another reason than its
neighbours.
"""

from __future__ import annotations

from typing import Final

PER_CORE: Final = 4
"""Processes that start at once on each core: while one waits for an answer, others compute."""

MAKES_ROOM_AFTER: Final = 2.0
"""Seconds after which a process that still starts keeps others from starting no more."""


class Starting:
    """A queue of names; times are seconds of one monotonic clock."""

    def __init__(self, at_once: int) -> None:
        self._at_once = at_once
        self._queue: dict[str, None] = {}
        self._places: dict[str, float] = {}

    @property
    def queued(self) -> frozenset[str]:
        """Those whose turn has yet to come."""
        return frozenset(self._queue)

    def add(self, name: str) -> None:
        """Let a process wait for its turn."""
        self._queue[name] = None

    def next(self, now: float) -> str | None:
        """Whose turn it is now, which takes a place; None where there is none, or no place."""
        busy = sum(since + MAKES_ROOM_AFTER > now for since in self._places.values())
        if not self._queue or busy >= self._at_once:
            return None
        name = next(iter(self._queue))
        del self._queue[name]
        self._places[name] = now
        return name

    def over(self, name: str) -> None:
        """A process has started, or has ended: its place is free."""
        self._places.pop(name, None)

    def cancel(self) -> None:
        """Let none start any more."""
        self._queue.clear()

    def look_at(self, now: float) -> float | None:
        """When there may be a place although nothing has happened; None where nobody waits."""
        if not self._queue:
            return None
        ends = [since + MAKES_ROOM_AFTER for since in self._places.values()]
        return min((end for end in ends if end > now), default=now)
