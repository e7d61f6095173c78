"""How quick hosts are, so that each gets as much of a population as it can do in the same time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Sized
from statistics import median
from typing import Final

WINDOW: Final = 16
_WORTH: Final = 8192
"""Moving rows costs more than it gains where a host has fewer than this."""

_BY_HOW_MUCH: Final = 1.3


class Load:
    """What hosts have done of late: rows a second, the median of some frames."""

    def __init__(self) -> None:
        self._speeds: dict[str, list[float]] = {}

    def took(self, host: str, rows: int, seconds: float) -> None:
        """A host has done so many rows in this time."""
        if rows and seconds > 0:
            speeds = self._speeds.setdefault(host, [])
            speeds.append(rows / seconds)
            del speeds[:-WINDOW]

    def weights(self, hosts: Sequence[str], rows: int) -> list[float]:
        """The shares of so many rows that suit these hosts.

        Equal ones while nothing is known of one of them, and where rows are few: what a host needs
        for a frame is then no matter of rows, and whoever has fewer would seem to be slow.
        """
        known = [self._speed(host) for host in hosts]
        return known if _many(rows, hosts) and all(known) else [1.0] * len(hosts)

    def lopsided(self, rows: Mapping[str, int]) -> bool:
        """Whether hosts with so many rows each would be much quicker with other shares."""
        speeds = [self._speed(host) for host in rows]
        if len(rows) < 2 or not all(speeds) or not _many(sum(rows.values()), rows):
            return False
        slowest = max(count / speed for count, speed in zip(rows.values(), speeds, strict=True))
        return slowest > _BY_HOW_MUCH * sum(rows.values()) / sum(speeds)

    def _speed(self, host: str) -> float:
        speeds = self._speeds.get(host, [])
        return median(speeds) if len(speeds) == WINDOW else 0.0


def _many(rows: int, hosts: Sized) -> bool:
    """Whether a host's time is a matter of how many rows it has."""
    return rows >= _WORTH * len(hosts)
