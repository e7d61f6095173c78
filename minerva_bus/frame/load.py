"""Speed of hosts, for shares of a population that take all hosts the same time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from statistics import median
from typing import Final

WINDOW: Final = 16
"""Frames over which the speed of a host is measured."""

_MIN_ROWS: Final = 8192
"""Rows per host below which the cost of moving rows exceeds the gain."""

_MAX_RATIO: Final = 1.3
"""Ratio of the slowest host's time to the balanced time that is worth moving rows."""


class Load:
    """Speed of hosts in rows per second: the median over the last `WINDOW` frames."""

    def __init__(self) -> None:
        self._speeds: dict[str, list[float]] = {}

    def note(self, host: str, rows: int, elapsed: float) -> None:
        """Note the seconds that a host needed for some rows."""
        if rows and elapsed > 0:
            speeds = self._speeds.setdefault(host, [])
            speeds.append(rows / elapsed)
            del speeds[:-WINDOW]

    def weights(self, hosts: Sequence[str], rows: int) -> list[float]:
        """Shares of some rows by the speed of these hosts.

        The shares are equal while the speed of a host is unknown, and for few rows: the
        time of a frame does then not depend on rows, so a host with fewer would seem slower.
        """
        known = [self._speed(host) for host in hosts]
        return known if _enough(rows, hosts) and all(known) else [1.0] * len(hosts)

    def imbalanced(self, rows: Mapping[str, int]) -> bool:
        """Whether other shares would be much faster than this number of rows per host."""
        speeds = [self._speed(host) for host in rows]
        # With few rows the time does not depend on their number. A host with fewer rows would then
        # seem slower, receive fewer still, and end with none.
        if len(rows) < 2 or not all(speeds) or not _enough(sum(rows.values()), rows):
            return False
        slowest = max(count / speed for count, speed in zip(rows.values(), speeds, strict=True))
        return slowest > _MAX_RATIO * sum(rows.values()) / sum(speeds)

    def _speed(self, host: str) -> float:
        speeds = self._speeds.get(host, [])
        # The median, so that a single slow frame does not move rows.
        return median(speeds) if len(speeds) == WINDOW else 0.0


def _enough(rows: int, hosts: Sized) -> bool:
    """Whether the number of its rows determines the time that a host needs."""
    return rows >= _MIN_ROWS * len(hosts)
