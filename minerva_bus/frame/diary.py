"""What those who watch a world are told of it: its last events, by type, and its log."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from itertools import islice

from minerva_bus.grammar.batch import AnyEvent, Events, single
from minerva_bus.world.operator import Happening, LogLine

FRAMES = 64
HAPPENINGS = 1000
LINES = 4000
LONGEST = 2000
TOLD = 300
AT_ONCE = 200
EACH = 2
"""Events of one type that are told one by one in a frame; of more, only how many."""


class Diary:
    """The last frames' events and the last lines of the log; bounded, whatever comes."""

    def __init__(self) -> None:
        self._counts: deque[Counter[str]] = deque(maxlen=FRAMES)
        self._happenings: deque[Happening] = deque(maxlen=HAPPENINGS)
        self._lines: deque[LogLine] = deque(maxlen=LINES)
        self._happened: int = 0
        self._logged: int = 0

    def frame(self, number: int, events: Iterable[AnyEvent]) -> None:
        """Note a frame's events, in their order."""
        counts: Counter[str] = Counter()
        for event in events:
            room = EACH - counts[event.type]
            counts[event.type] += len(event) if isinstance(event, Events) else 1
            for one in islice(single((event,)), max(0, room)):
                self._happens(number, one.type, _short(str(one), TOLD))
        for event_type, count in sorted(counts.items()):
            if count > EACH:
                self._happens(number, event_type, f"{event_type}: {count} of them in this frame")
        self._counts.append(counts)

    def said(
        self, time: float, member: str, text: str, frame: int = 0, level: str = "info"
    ) -> None:
        """Note a member's line, or a word about it; `time` is in seconds since 1970."""
        for line in text.rstrip("\n").split("\n"):
            self._logged += 1
            self._lines.append(LogLine(self._logged, time, member, _short(line), frame, level))

    def per_frame(self) -> dict[str, float]:
        """How many events of each type a frame has had, on average of the last ones."""
        total: Counter[str] = Counter()
        for counts in self._counts:
            total.update(counts)
        return {one: total[one] / len(self._counts) for one in sorted(total)}

    def happenings(self, since: int) -> tuple[Happening, ...]:
        """What has happened after the happening of this number."""
        found = [one for one in self._happenings if one.number > since]
        return tuple(found[-AT_ONCE:])

    def lines(self, since: int, member: str = "") -> tuple[LogLine, ...]:
        """The log after the line of this number, of one member or of all."""
        return tuple(
            [line for line in self._lines if line.number > since and member in ("", line.member)]
        )

    def _happens(self, frame: int, about: str, text: str) -> None:
        self._happened += 1
        self._happenings.append(Happening(self._happened, frame, about, text))


def _short(text: str, longest: int = LONGEST) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"
