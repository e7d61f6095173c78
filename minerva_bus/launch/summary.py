"""The summary of a run, and the duration of its start."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from minerva_bus.wording import counted


@dataclass(slots=True)
class Laps:
    """Duration of each part of a start, seconds; `began` is on the monotonic clock."""

    began: float
    parts: dict[str, float] = field(default_factory=dict[str, float])

    @property
    def total(self) -> float:
        """Seconds from the start to the end of the last part."""
        return sum(self.parts.values())

    def end(self, part: str) -> None:
        """Note the end of a part, with the time since the part before."""
        self.parts[part] = time.monotonic() - self.began - self.total


@dataclass(frozen=True, slots=True)
class FirstFrame:
    """The first frame that a run completed: its number, when, and the seconds until then.

    `at` is of the coordinators' clock, which is the same for all that follow one another.
    """

    frame: int
    at: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Summary:
    """A run's end in figures; members add their own (`distance_driven`, `collisions`, ...).

    `before` is how many of the frames ran before this run, which went on from a record or a
    journal. `wall_seconds` is from the end of its first frame to the end of its last one, also
    where another coordinator followed in between. `first_frame_seconds` is None where no frame was
    completed. `digest` is empty where the world ended without a word of its coordinator.
    """

    world: str
    frames: int
    digest: str
    reached: bool
    ended: str
    wall_seconds: float
    first_frame_seconds: float | None
    members: int
    seed: int
    startup: Mapping[str, float]
    figures: Mapping[str, Any]
    before: int = 0
    profile: Mapping[str, Mapping[str, float]] = field(
        default_factory=dict[str, Mapping[str, float]]
    )

    @property
    def frames_per_second(self) -> float:
        """Frames per second, from the first frame's end to the last one's."""
        ran = self.frames - self.before
        return ran / self.wall_seconds if self.wall_seconds > 0 else 0.0

    def plain(self) -> dict[str, Any]:
        """The summary as a JSON object; a member's figure never replaces one of these."""
        first = self.first_frame_seconds
        own: dict[str, Any] = {
            "world": self.world,
            "frames": self.frames,
            "frames_before": self.before,
            "digest": self.digest or None,
            "reached": self.reached,
            "wall_seconds": round(self.wall_seconds, 3),
            "frames_per_second": round(self.frames_per_second, 1),
            "first_frame_seconds": first if first is None else round(first, 3),
            "startup_seconds": {name: round(value, 3) for name, value in self.startup.items()},
            "members": self.members,
            "seed": self.seed,
            "ended": self.ended,
        }
        if self.profile:
            own["profile"] = {name: dict(row) for name, row in self.profile.items()}
        figures = {name: _plain(value) for name, value in self.figures.items()}
        return own | {name: value for name, value in figures.items() if name not in own}

    def _first_frame_shown(self) -> str:
        seconds = self.first_frame_seconds
        return "no frame was completed" if seconds is None else f"first frame after {seconds:.2f} s"

    def _startup_shown(self) -> str:
        parts = [f"{name} {value:.2f}" for name, value in self.startup.items()]
        return f" ({', '.join(parts)})" if parts else ""

    def lines(self) -> list[str]:
        """The summary as text."""
        earlier = f" ({self.before} before)" if self.before else ""
        shown = [
            f"{self.world}: {self.ended}",
            f"  {counted(self.frames, 'frame')}{earlier} in {self.wall_seconds:.1f} s"
            f" ({self.frames_per_second:.0f} per second), {counted(self.members, 'member')}",
            f"  {self._first_frame_shown()}" + self._startup_shown(),
        ]
        for name, value in self.figures.items():
            text = f"{value:.2f}" if isinstance(value, float) else str(value)
            shown.append(f"  {name.replace('_', ' ')}: {text}")
        digest = f"  digest {self.digest}  (seed {self.seed})"
        return [*shown, digest, *_profile_shown(self.profile)]


def _profile_shown(profile: Mapping[str, Mapping[str, float]]) -> list[str]:
    """A profile as a table."""
    if not profile:
        return []
    width = max(map(len, profile))
    titles = f"  {'µs or bytes a frame':{width}} {'mean':>11} {'p50':>11} {'p99':>11} {'frames':>9}"
    rows = [
        f"  {name:{width}} {row['mean']:11,.1f} {row['p50']:11,.1f} {row['p99']:11,.1f}"
        f" {row['frames']:9,.0f}"
        for name, row in profile.items()
    ]
    return [titles, *rows]


def _plain(value: Any) -> Any:
    """A figure for JSON, which has neither NaN nor infinity."""
    return None if isinstance(value, float) and not isfinite(value) else value
