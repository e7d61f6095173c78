"""What of a damaged record is lost, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from minerva_bus.log.scanning import Damage

SHOWN: Final = 5
"""Ranges of lost frames that are named."""


@dataclass(frozen=True, slots=True)
class Losses:
    """What of a record cannot be used.

    `damage` are bytes that cannot be read, `cut` so many at the end that are of no whole chunk.
    `lost` are frames; those from number `open_from` on are lost, too, if there were any.
    """

    damage: tuple[Damage, ...]
    cut: int
    lost: tuple[range, ...]
    open_from: int | None

    @property
    def damaged(self) -> str:
        """Where it is damaged, in words; empty where it is not."""
        if not self.damage:
            return ""
        first, more = self.damage[0], len(self.damage) - 1
        others = f", and {more:,} more places" if more > 1 else ", and one more place"
        where = f"bytes {first.begin:,} to {first.end - 1:,} ({first.why})"
        return where + (others if more else "")

    @property
    def frames(self) -> str:
        """Which frames that has cost, in words; empty where nothing is damaged."""
        if not self.damage:
            return ""
        named = [_spanned(one) for one in self.lost[:SHOWN]]
        if len(self.lost) > SHOWN:
            named.append(f"{sum(map(len, self.lost[SHOWN:])):,} more")
        if self.open_from is not None:
            named.append(f"all from frame {self.open_from:,} on")
        return ", ".join(named) or "no frame"

    def plain(self) -> dict[str, Any]:
        """As one JSON object; `lost_from` is nil where the end is intact."""
        return {
            "damage": [{"begin": d.begin, "end": d.end, "why": d.why} for d in self.damage],
            "cut": self.cut,
            "lost": [[one.start, one.stop - 1] for one in self.lost],
            "lost_from": self.open_from,
        }


def _spanned(frames: range) -> str:
    if len(frames) == 1:
        return f"frame {frames.start:,}"
    return f"frames {frames.start:,} to {frames.stop - 1:,}"
