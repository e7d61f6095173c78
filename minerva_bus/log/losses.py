"""Losses of a damaged record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from minerva_bus.log.scanning import Damage

SHOWN: Final = 5
"""Maximum number of ranges of lost frames that are listed."""


@dataclass(frozen=True, slots=True)
class Losses:
    """The parts of a record that cannot be used.

    `damage`: unreadable bytes. `cut`: bytes at the end outside of complete chunks. `lost`:
    ranges of frames; frames from number `open_from` on, if there were any, are lost too.
    """

    damage: tuple[Damage, ...]
    cut: int
    lost: tuple[range, ...]
    open_from: int | None

    @property
    def damaged(self) -> str:
        """Damaged places as text, or an empty string."""
        if not self.damage:
            return ""
        first, more = self.damage[0], len(self.damage) - 1
        others = f", and {more:,} more places" if more > 1 else ", and one more place"
        where = f"bytes {first.begin:,} to {first.end - 1:,} ({first.why})"
        return where + (others if more else "")

    @property
    def frames(self) -> str:
        """Frames lost by the damage as text, or an empty string."""
        if not self.damage:
            return ""
        named = [_range_text(frames) for frames in self.lost[:SHOWN]]
        if len(self.lost) > SHOWN:
            named.append(f"{sum(map(len, self.lost[SHOWN:])):,} more")
        if self.open_from is not None:
            named.append(f"all from frame {self.open_from:,} on")
        return ", ".join(named) or "no frame"

    def message(self, path: Path) -> str:
        """One line about the damage of the record at a path, or an empty string."""
        return f"{path} is damaged: {self.damaged}; lost: {self.frames}" if self.damage else ""

    def plain(self) -> dict[str, Any]:
        """As a JSON object; `lost_from` is null if the end is intact."""
        return {
            "damage": [{"begin": d.begin, "end": d.end, "why": d.why} for d in self.damage],
            "cut": self.cut,
            "lost": [[frames.start, frames.stop - 1] for frames in self.lost],
            "lost_from": self.open_from,
        }


def _range_text(frames: range) -> str:
    if len(frames) == 1:
        return f"frame {frames.start:,}"
    return f"frames {frames.start:,} to {frames.stop - 1:,}"
