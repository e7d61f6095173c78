"""Limits the number of processes that start at the same time.

A starting process needs a core for about 0.1 s. If hundreds start at once, each takes seconds and
all of them exceed their time-outs. So each waits in a queue for a slot. It frees the slot when it
has sent `hello`, when it has ended, or after `SLOT_SECONDS`: then it waits for something other than
a core.
"""

from __future__ import annotations

from typing import Final

STARTS_PER_CORE: Final = 4
"""More than one, because a process that waits for an answer leaves its core to others."""

SLOT_SECONDS: Final = 2.0
"""Time after which a starting process no longer prevents others from starting."""


class StartQueue:
    """A queue of process names with a number of slots; times are monotonic seconds."""

    def __init__(self, slots: int) -> None:
        self._slots = slots
        # A dict is an ordered set here: a process that is added twice starts once.
        self._queue: dict[str, None] = {}
        self._started: dict[str, float] = {}

    @property
    def queued(self) -> frozenset[str]:
        """The names that wait for a slot."""
        return frozenset(self._queue)

    def add(self, name: str) -> None:
        """Add a process to the queue."""
        self._queue[name] = None

    def next(self, now: float) -> str | None:
        """Take the first process that has a slot; None if the queue is empty or all are busy."""
        busy = sum(since + SLOT_SECONDS > now for since in self._started.values())
        if not self._queue or busy >= self._slots:
            return None
        name = next(iter(self._queue))
        del self._queue[name]
        self._started[name] = now
        return name

    def free(self, name: str) -> None:
        """Free the slot of a process that has started or ended."""
        self._started.pop(name, None)

    def clear(self) -> None:
        """Remove all processes from the queue."""
        self._queue.clear()

    def next_at(self, now: float) -> float | None:
        """Time of the next slot that becomes free by time-out; None if no process waits for one."""
        if not self._queue:
            return None
        ends = [since + SLOT_SECONDS for since in self._started.values()]
        return min((end for end in ends if end > now), default=now)
