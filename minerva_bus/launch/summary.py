"""The summary of a run, and the duration of its start."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Final

from minerva_bus.frame.description import WorldSpec
from minerva_bus.wire.plain import on_screen
from minerva_bus.wording import counted

Profile = Mapping[str, Mapping[str, float]]

_FAILURE: Final = re.compile(r"\S+ failed(?: in frame \d+)?(?=: )")


@dataclass(slots=True)
class Startup:
    """Duration of each part of a start, seconds; `began` is on the monotonic clock.

    `first_frame` is the number of the first completed frame, `first_at` its end on the
    coordinators' clock, which successors share, `first_seconds` the time until this end.
    """

    began: float
    parts: dict[str, float] = field(default_factory=dict[str, float])
    first_frame: int | None = None
    first_at: float = 0.0
    first_seconds: float | None = None

    def end(self, part: str) -> None:
        """Note the end of a part: its time is that since the part before."""
        self.parts[part] = time.monotonic() - self.began - sum(self.parts.values())

    def completed(self, frame: int, at: float) -> None:
        """Note a completed frame; only the first one counts."""
        if self.first_frame is None:
            self.end("members and frame 0")
            self.first_frame, self.first_at = frame, at
            self.first_seconds = sum(self.parts.values())


@dataclass(frozen=True, slots=True)
class EndReport:
    """The coordinator's last report; `last_frame_at` is on the monotonic clock, seconds."""

    reason: str
    frames: int
    last_frame_at: float
    members: int
    failed: bool = False
    digest: str = ""
    reached: bool = False
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
    profile: Profile = field(default_factory=dict[str, Mapping[str, float]])


@dataclass(frozen=True, slots=True)
class RunSummary:
    """The result of a run; members add figures of their own (`distance_driven`, ...).

    `before` is the number of frames that ran before this run, if it resumed a record or a journal.
    `wall_seconds` is from the end of its first frame to the end of its last one, successions
    included. `first_frame_seconds` is None if no frame was completed. `digest` is empty if the
    coordinator ended without a report.
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
    profile: Profile = field(default_factory=dict[str, Mapping[str, float]])

    @staticmethod
    def of(world: WorldSpec, report: EndReport, startup: Startup, failure: str) -> RunSummary:
        """The summary of a run over the bus."""
        began = startup.first_frame is not None
        return RunSummary(
            world=world.name,
            frames=report.frames,
            digest=report.digest,
            reached=report.reached,
            ended=failure or report.reason,
            wall_seconds=max(0.0, report.last_frame_at - startup.first_at) if began else 0.0,
            first_frame_seconds=startup.first_seconds,
            members=report.members,
            seed=world.seed,
            startup=startup.parts,
            figures=report.figures,
            # A run that continues from a journal begins later than in its world file.
            before=world.past.frame if startup.first_frame is None else startup.first_frame,
            profile=report.profile,
        )

    @property
    def frames_per_second(self) -> float:
        """Frames per second, from the end of the first frame to that of the last."""
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

    def lines(self) -> list[str]:
        """The summary as text, without what the log has said about a failure of user code."""
        earlier = f" ({self.before} before)" if self.before else ""
        first = self.first_frame_seconds
        began = "no frame was completed" if first is None else f"first frame after {first:.2f} s"
        parts = ", ".join(f"{name} {value:.2f}" for name, value in self.startup.items())
        shown = [
            f"{self.world}: {_brief(self.ended)}",
            f"  {counted(self.frames, 'frame')}{earlier} in {self.wall_seconds:.1f} s"
            f" ({self.frames_per_second:.0f} per second), {counted(self.members, 'member')}",
            f"  {began}" + (f" ({parts})" if parts else ""),
        ]
        for name, value in self.figures.items():
            text = f"{value:.2f}" if isinstance(value, float) else str(value)
            # A member in any language may report any characters.
            line = " ".join(f"{name.replace('_', ' ')}: {text}".split("\n"))
            shown.append(f"  {on_screen(line)}")
        digest = f"  digest {self.digest}  (seed {self.seed})"
        return [*shown, digest, *_profile_lines(self.profile)]


def _brief(ended: str) -> str:
    """The reason of an end without the error's own text, which the log has with its location."""
    match = _FAILURE.match(ended)
    return match[0] if match else ended


def _profile_lines(profile: Profile) -> list[str]:
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
