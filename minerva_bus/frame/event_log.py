"""Bounded log of a running world: its last events, by type, and its last log lines."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from itertools import islice
from typing import Final

from minerva_bus.grammar.events import AnyEvent
from minerva_bus.world.operator import LogEntry, LogLine

FRAMES: Final = 64
"""Frames over which the rate of events is averaged."""

MAX_ENTRIES: Final = 1000
MAX_LINES: Final = 4000
MAX_LINE_LENGTH: Final = 2000
MAX_ENTRY_LENGTH: Final = 300
MAX_REPLY: Final = 200
"""Entries in one reply to a reader."""

MAX_PER_TYPE: Final = 2
"""Maximum events of one type that are logged singly in a frame; further ones are counted."""


class EventLog:
    """The events of the last frames and the last log lines; older ones are dropped."""

    def __init__(self) -> None:
        self._counts: deque[Counter[str]] = deque(maxlen=FRAMES)
        self._entries: deque[LogEntry] = deque(maxlen=MAX_ENTRIES)
        self._lines: deque[LogLine] = deque(maxlen=MAX_LINES)
        self._last_entry: int = 0
        self._last_line: int = 0

    def frame(self, number: int, events: Iterable[AnyEvent]) -> None:
        """Log a frame's events, in their order."""
        counts: Counter[str] = Counter()
        for batch in events:
            room = MAX_PER_TYPE - counts[batch.type]
            counts[batch.type] += len(batch)
            # Iterating over a batch makes an event for each row, so only
            # the rows that are logged are read.
            for event in islice(batch, max(0, room)):
                self._add(number, event.type, _short(str(event), MAX_ENTRY_LENGTH))
        for event_type, count in sorted(counts.items()):
            if count > MAX_PER_TYPE:
                self._add(number, event_type, f"{event_type}: {count} of them in this frame")
        self._counts.append(counts)

    def line(
        self, time: float, member: str, text: str, frame: int = 0, level: str = "info"
    ) -> None:
        """Log a line of a member or about it; `time` is in seconds since 1970."""
        for line in text.rstrip("\n").split("\n"):
            self._last_line += 1
            self._lines.append(LogLine(self._last_line, time, member, _short(line), frame, level))

    def per_frame(self) -> dict[str, float]:
        """Average number of events per frame, by type, over the last frames."""
        total: Counter[str] = Counter()
        for counts in self._counts:
            total.update(counts)
        return {event_type: total[event_type] / len(self._counts) for event_type in sorted(total)}

    def entries(self, since: int) -> tuple[LogEntry, ...]:
        """The latest entries after the entry of this number."""
        entries = [entry for entry in self._entries if entry.number > since]
        return tuple(entries[-MAX_REPLY:])

    def lines(self, since: int, member: str = "") -> tuple[LogLine, ...]:
        """The log lines after the line of this number, of one member or of all."""
        return tuple(
            [line for line in self._lines if line.number > since and member in ("", line.member)]
        )

    def _add(self, frame: int, about: str, text: str) -> None:
        self._last_entry += 1
        self._entries.append(LogEntry(self._last_entry, frame, about, text))


def _short(text: str, longest: int = MAX_LINE_LENGTH) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"
