"""What a person sees of a run: a line that lives at the bottom, and log lines above it."""

from __future__ import annotations

import shutil
import sys
import time
from dataclasses import dataclass, field
from typing import Any, TextIO

_COLORS = (36, 33, 35, 32, 34, 96, 93, 95, 92, 94)


@dataclass(slots=True)
class Console:
    """Writes to a terminal, or plainly to anything else.

    `quiet` leaves out all but what went wrong.
    """

    stream: TextIO = field(default_factory=lambda: sys.stderr)
    quiet: bool = False
    _live: str = ""
    _names: dict[str, int] = field(default_factory=dict[str, int])

    @property
    def terminal(self) -> bool:
        """Whether a person looks at it."""
        return self.stream.isatty()

    def log(self, name: str, line: str) -> None:
        """A line about a member, with its name in front."""
        shown = name
        if self.terminal:
            color = _COLORS[self._names.setdefault(name, len(self._names)) % len(_COLORS)]
            shown = f"\x1b[{color}m{name}\x1b[0m"
        self._above("".join(f"{shown} │ {one}\n" for one in line.rstrip("\n").split("\n")))

    def note(self, line: str) -> None:
        """A line about the world."""
        if not self.quiet:
            self._above(line + "\n")

    def live(self, line: str) -> None:
        """Let the line at the bottom be this."""
        if not self.terminal or self.quiet:
            return
        width = shutil.get_terminal_size().columns - 1
        line = line[:width]
        if line != self._live:
            self.stream.write(f"\r\x1b[2K{line}")
            self.stream.flush()
            self._live = line

    def end(self) -> None:
        """Take the line at the bottom away."""
        if self._live:
            self.stream.write("\r\x1b[2K")
            self.stream.flush()
            self._live = ""

    def _above(self, lines: str) -> None:
        live = self._live
        self.end()
        self.stream.write(lines)
        self.stream.flush()
        if live:
            self.live(live)


def live_line(world: str, status: dict[str, Any], frames: int, began: float) -> str:
    """The line at the bottom of a run."""
    seconds = time.monotonic() - began
    frame = int(status["frame"])
    total = f"/{frames}" if frames else ""
    bar = ""
    if frames:
        done = min(12, 12 * frame // frames)
        bar = f" {'█' * done}{'░' * (12 - done)}"
    shown = (
        f"{world}{bar}  frame {frame}{total}  {_speed(status)}  "
        f"{status['members']} members  {seconds:.0f} s"
    )
    if status["waiting"] and status["waited"] >= 0.3:
        names = ", ".join(status["waiting"])
        shown += f"  waiting for {names} since {status['waited']:.1f} s"
    return shown


def _speed(status: dict[str, Any]) -> str:
    return "paused" if status.get("paused") else f"{status['rate']:.0f} Hz"
