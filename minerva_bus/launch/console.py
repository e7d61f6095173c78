"""What a person sees of a run: a line that lives at the bottom, and log lines above it."""

from __future__ import annotations

import shutil
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TextIO

from minerva_bus.launch.loglines import Entry
from minerva_bus.wording import counted, named_some

SHOWN_NAMES = 8
NOW_AND_THEN = 5.0
"""Seconds between two lines about something that goes on, where no person looks at a terminal."""

_COLORS = (36, 33, 35, 32, 34, 96, 93, 95, 92, 94)


@dataclass(slots=True)
class Console:
    """Writes to a terminal, or plainly to anything else; or JSON, one object a line.

    `quiet` leaves out all but what went wrong. `world` and `frame` are those that lines in JSON
    are about; the frame is the last one that was heard of. `traceback` shows what else is only in
    the log: all frames of an error in user code.
    """

    stream: TextIO = field(default_factory=lambda: sys.stderr)
    quiet: bool = False
    json: bool = False
    world: str = ""
    frame: int = -1
    traceback: bool = False
    _live: str = ""
    _said_at: float | None = None
    _names: dict[str, int] = field(default_factory=dict[str, int])

    @property
    def terminal(self) -> bool:
        """Whether a person looks at it."""
        return self.stream.isatty() and not self.json

    def log(self, name: str, line: str, level: str = "info") -> None:
        """A line about a member, with its name in front."""
        if self.json:
            self._write(level, name, line)
            return
        shown = name
        if self.terminal:
            color = _COLORS[self._names.setdefault(name, len(self._names)) % len(_COLORS)]
            shown = f"\x1b[{color}m{name}\x1b[0m"
        self._above("".join(f"{shown} │ {one}\n" for one in line.rstrip("\n").split("\n")))

    def details(self, name: str, text: str) -> None:
        """What else there is to an error in a member's code, where people want all of it."""
        if text and self.traceback:
            self.log(name, text, "warning")

    def note(self, line: str) -> None:
        """A line about the world."""
        if self.quiet:
            return
        if self.json:
            self._write("info", "", line.removeprefix(f"{self.world}: "))
        else:
            self._above(line + "\n")

    def now_and_then(self, line: str, now: float) -> None:
        """A line about the world that will soon be out of date; `now` is of a monotonic clock."""
        if self._said_at is None:
            self._said_at = now
        if now >= self._said_at + NOW_AND_THEN:
            self._said_at = now
            self.note(line)

    def problem(self, line: str) -> None:
        """What went wrong with the world as a whole."""
        if self.json:
            self._write("error", "", line)
        else:
            name = f"{self.world}: " if self.world else ""
            self._above(f"minerva: {name}{line}\n")

    def _write(self, level: str, member: str, text: str) -> None:
        now = time.time()
        for line in text.rstrip("\n").split("\n"):
            entry = Entry(now, level, self.world, self.frame, member, line)
            self._put(entry.json() + "\n")

    def live(self, line: str) -> None:
        """Let the line at the bottom be this."""
        if not self.terminal or self.quiet:
            return
        width = shutil.get_terminal_size().columns - 1
        line = line[:width]
        if line != self._live:
            self._put(f"\r\x1b[2K{line}")
            self._live = line

    def progress(self, name: str, done: int, total: int, rest: str) -> None:
        """Let the line at the bottom say how much of something is done."""
        self.live(f"{name} {_bar(done, total, 20)}  {done}/{total} {rest}")

    def end(self) -> None:
        """Take the line at the bottom away."""
        if self._live:
            self._put("\r\x1b[2K")
            self._live = ""

    def _put(self, text: str) -> None:
        """Write to a terminal that may have been closed: the run goes on to its regular end."""
        with suppress(OSError):
            self.stream.write(text)
            self.stream.flush()

    def _above(self, lines: str) -> None:
        live = self._live
        self.end()
        self._put(lines)
        if live:
            self.live(live)


def starting_line(status: dict[str, Any], total: int) -> str:
    """What is left to do until a world begins: who has come, and for whom it waits."""
    here = min(int(status["members"]), total)
    shown = f"{here:,} of {counted(total, 'member')} here"
    waiting = [str(name) for name in status["waiting"]]
    return f"{shown}; waiting for {named_some(waiting, SHOWN_NAMES)}" if waiting else shown


def live_line(world: str, status: dict[str, Any], frames: int, began: float) -> str:
    """The line at the bottom of a run."""
    seconds = time.monotonic() - began
    frame = int(status["frame"])
    total = f"/{frames}" if frames else ""
    bar = f" {_bar(frame, frames, 12)}" if frames else ""
    shown = (
        f"{world}{bar}  frame {frame}{total}  {_speed(status)}  "
        f"{counted(int(status['members']), 'member')}  {seconds:.0f} s"
    )
    if status["waiting"] and status["waited"] >= 0.3:
        names = named_some(status["waiting"], SHOWN_NAMES)
        shown += f"  waiting for {names} since {status['waited']:.1f} s"
    return shown


def _bar(done: int, total: int, width: int) -> str:
    part = min(width, width * done // total)
    return f"{'█' * part}{'░' * (width - part)}"


def _speed(status: dict[str, Any]) -> str:
    return "paused" if status.get("paused") else f"{status['rate']:.0f} Hz"
