"""Console of a run: a status line at the bottom, and log lines above it, or JSON lines."""

from __future__ import annotations

import json
import shutil
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final, TextIO

from minerva_bus.wording import counted, named_some

SHOWN_NAMES: Final = 8
PERIOD_SECONDS: Final = 5.0
"""Time between two lines about progress if there is no terminal for a status line."""

_COLORS = (36, 33, 35, 32, 34, 96, 93, 95, 92, 94)


def json_line(at: float, level: str, world: str, frame: int, member: str, message: str) -> str:
    """A log line as a JSON object, the same for a run and for `minerva logs`.

    `at`: seconds since 1970, written as RFC 3339 in UTC. `level`: info, warning or error.
    `frame`: the current one, -1 if unknown. `member` is empty for the world itself.
    """
    written = datetime.fromtimestamp(at, UTC).isoformat(timespec="milliseconds")
    entry = {
        "time": written.replace("+00:00", "Z"),
        "level": level,
        "world": world,
        "frame": frame,
        "member": member,
        "message": message,
    }
    return json.dumps(entry, ensure_ascii=False)


@dataclass(slots=True)
class Console:
    """Writes log lines with a status line to a terminal, plain lines elsewhere, or JSON lines.

    `quiet` suppresses all but errors. `world` and `frame` go into JSON lines; the frame is the last
    one that was reported. `traceback`: also show all frames of errors in user code, which otherwise
    are only in the log.
    """

    stream: TextIO = field(default_factory=lambda: sys.stderr)
    quiet: bool = False
    json: bool = False
    world: str = ""
    frame: int = -1
    traceback: bool = False
    _live: str = ""
    _noted_at: float | None = None
    _names: dict[str, int] = field(default_factory=dict[str, int])

    @property
    def terminal(self) -> bool:
        """Whether the output is a terminal and not JSON."""
        return self.stream.isatty() and not self.json

    def log(self, name: str, line: str, level: str = "info") -> None:
        """Write a line about a member, after its name."""
        if self.json:
            self._write(level, name, line)
            return
        shown = name
        if self.terminal:
            # Colours are assigned by first appearance, so the first ten names have different ones.
            color = _COLORS[self._names.setdefault(name, len(self._names)) % len(_COLORS)]
            shown = f"\x1b[{color}m{name}\x1b[0m"
        self._above("".join(f"{shown} │ {text}\n" for text in line.rstrip("\n").split("\n")))

    def details(self, name: str, text: str) -> None:
        """Write all frames of an error in a member's code, if `traceback` is set."""
        if text and self.traceback:
            self.log(name, text, "warning")

    def note(self, line: str) -> None:
        """Write a line about the world."""
        if self.quiet:
            return
        if self.json:
            self._write("info", "", line.removeprefix(f"{self.world}: "))
        else:
            self._above(line + "\n")

    def periodic(self, line: str, now: float) -> None:
        """Write a line about progress if one is due; `now` is monotonic."""
        # No line at the beginning: a start that is shorter than a period needs none.
        if self._noted_at is None:
            self._noted_at = now
        if now >= self._noted_at + PERIOD_SECONDS:
            self._noted_at = now
            self.note(line)

    def problem(self, line: str) -> None:
        """Write an error of the world as a whole."""
        if self.json:
            self._write("error", "", line)
        else:
            name = f"{self.world}: " if self.world else ""
            self._above(f"minerva: {name}{line}\n")

    def _write(self, level: str, member: str, text: str) -> None:
        now = time.time()
        for line in text.rstrip("\n").split("\n"):
            self._put(json_line(now, level, self.world, self.frame, member, line) + "\n")

    def live(self, line: str) -> None:
        """Replace the status line."""
        if not self.terminal or self.quiet:
            return
        # A wrapped line would leave its upper part behind when it is replaced.
        line = line[: shutil.get_terminal_size().columns - 1]
        if line != self._live:
            self._put(f"\r\x1b[2K{line}")
            self._live = line

    def progress(self, name: str, done: int, total: int, rest: str) -> None:
        """Show a progress bar in the status line."""
        self.live(f"{name} {_bar(done, total, 20)}  {done}/{total} {rest}")

    def end(self) -> None:
        """Remove the status line."""
        if self._live:
            self._put("\r\x1b[2K")
            self._live = ""

    def _put(self, text: str) -> None:
        """Write, ignoring a closed terminal: the run continues to its regular end."""
        with suppress(OSError):
            self.stream.write(text)
            self.stream.flush()

    def _above(self, lines: str) -> None:
        # The status line has to stay the last line of the terminal.
        live = self._live
        self.end()
        self._put(lines)
        if live:
            self.live(live)


def starting_line(status: dict[str, Any], total: int) -> str:
    """The status line of a start: the number of members that have joined, and missing ones."""
    here = min(int(status["members"]), total)
    shown = f"{here:,} of {counted(total, 'member')} joined"
    waiting = [str(name) for name in status["waiting"]]
    return f"{shown}; waiting for {named_some(waiting, SHOWN_NAMES)}" if waiting else shown


def live_line(world: str, status: dict[str, Any], frames: int, began: float) -> str:
    """The status line of a running world."""
    seconds = time.monotonic() - began
    speed = "paused" if status.get("paused") else f"{status['rate']:.0f} Hz"
    frame = int(status["frame"])
    total = f"/{frames}" if frames else ""
    bar = f" {_bar(frame, frames, 12)}" if frames else ""
    shown = (
        f"{world}{bar}  frame {frame}{total}  {speed}  "
        f"{counted(int(status['members']), 'member')}  {seconds:.0f} s"
    )
    if status["waiting"] and status["waited"] >= 0.3:
        names = named_some(status["waiting"], SHOWN_NAMES)
        shown += f"  waiting for {names} for {status['waited']:.1f} s"
    return shown


def _bar(done: int, total: int, width: int) -> str:
    part = min(width, width * done // total)
    return f"{'█' * part}{'░' * (width - part)}"
