"""Totals of the measured frames of a world; they only increase, as Prometheus requires."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.wire.plain import as_int, as_list, as_map, as_number

BOUNDS: Final = (
    0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5,
    10.0,
)  # fmt: skip
"""Upper bounds of the histogram buckets, in seconds."""

_BYTES: Final = ("bytes in", "bytes out")
_MICRO: Final = 1e-6


@dataclass(slots=True)
class Durations:
    """Histogram of durations: a count for each of BOUNDS and one beyond, and their sum in s."""

    counts: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS) + 1))
    seconds: float = 0.0

    def add(self, seconds: float) -> None:
        """Count one duration."""
        # Bounds are inclusive, as in Prometheus.
        self.counts[bisect_left(BOUNDS, seconds)] += 1
        self.seconds += seconds


@dataclass(slots=True)
class Totals:
    """Frames, their parts' durations, events by type, and bytes from and to members."""

    frames: int = 0
    phases: dict[str, Durations] = field(default_factory=dict[str, Durations])
    events: dict[str, int] = field(default_factory=dict[str, int])
    bytes_in: int = 0
    bytes_out: int = 0

    def add(self, sums: Mapping[str, float]) -> None:
        """Count one frame's sums: microseconds by part, and bytes.

        Waiting times of single members are omitted: a histogram for each member would be too much.
        """
        self.frames += 1
        self.bytes_in += int(sums.get("bytes in", 0))
        self.bytes_out += int(sums.get("bytes out", 0))
        for name, amount in sums.items():
            if name not in _BYTES and not name.startswith("wait for "):
                self.phases.setdefault(name, Durations()).add(_MICRO * amount)

    def count(self, events: Iterable[AnyEvent]) -> None:
        """Count one frame's events."""
        for event in events:
            self.events[event.type] = self.events.get(event.type, 0) + len(event)

    def plain(self) -> dict[str, Any]:
        """The totals as plain data."""
        return {
            "frames": self.frames,
            "phases": {name: [d.counts, d.seconds] for name, d in sorted(self.phases.items())},
            "events": dict(sorted(self.events.items())),
            "bytes": [self.bytes_in, self.bytes_out],
        }


def read_totals(plain: Any) -> Totals:
    """Totals from plain data. Raises ProtocolError."""
    given = as_map(plain, "totals")
    into, out = _pair(given.get("bytes"), "bytes")
    phases = as_map(given.get("phases"), "phases")
    events = as_map(given.get("events"), "events")
    return Totals(
        as_int(given.get("frames"), "frames"),
        {name: _durations(durations) for name, durations in phases.items()},
        {name: as_int(count, name) for name, count in events.items()},
        as_int(into, "bytes"),
        as_int(out, "bytes"),
    )


def _durations(plain: Any) -> Durations:
    counts, seconds = _pair(plain, "durations")
    numbers = [as_int(count, "a count") for count in as_list(counts, "counts")]
    if len(numbers) != len(BOUNDS) + 1:
        raise ProtocolError(f"durations have {len(BOUNDS) + 1} counts, not {len(numbers)}")
    return Durations(numbers, as_number(seconds, "seconds"))


def _pair(plain: Any, what: str) -> tuple[Any, Any]:
    values = as_list(plain, what)
    if len(values) != 2:
        raise ProtocolError(f"{what} are two values, not {len(values)}")
    return values[0], values[1]
