"""What a run shows: a status line with log lines above it, or JSON lines, and its summary.

Members without a process of their own print to the standard output of the process, in which other
threads print, and other worlds run. So `printed` replaces it by a stream that passes on what a
thread writes to the run of this thread. Python does not know which thread has started another, so
a run names its threads. A thread that code of the world starts belongs to the run only if all
threads do: if the process runs nothing else, as for `minerva run`.
"""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Container, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import lru_cache
from math import isfinite
from typing import TYPE_CHECKING, Any, Final, TextIO

from minerva_bus.frame.world_state import WorldSpec
from minerva_bus.values import fast_dataclass
from minerva_bus.wire.plain import on_screen
from minerva_bus.wording import counted, named_some

if TYPE_CHECKING:
    from minerva_bus.runtime.questions import WorldRun
    from minerva_bus.world.operator import FileStatus

SHOWN_NAMES: Final = 8
PERIOD_SECONDS: Final = 5.0
"""Time between two lines about progress if there is no terminal for a status line."""

_COLORS = (36, 33, 35, 32, 34, 96, 93, 95, 92, 94)

Profile = Mapping[str, Mapping[str, float]]

_FAILURE: Final = re.compile(r"\S+ failed(?: in frame \d+)?(?=: )")


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
        if self.terminal and not os.environ.get("NO_COLOR"):
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


@contextmanager
def progress_bar(label: str, *, quiet: bool = False) -> Generator[Callable[[int, int], None]]:
    """A progress bar on standard error, if it is a terminal; called with done and total."""
    console = Console(quiet=quiet)
    try:
        yield lambda done, total: console.progress(label, done, max(1, total), "")
    finally:
        console.end()


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


@fast_dataclass
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
    reporters: Mapping[str, str] = field(default_factory=dict[str, str])
    incomplete: Sequence[str] = ()

    @staticmethod
    def of(run: WorldRun, members: int, reason: str = "") -> EndReport:
        """The report of a run; `reason` is that of a run that did not end by itself."""
        algorithm, ended = run.algorithm, run.result
        return EndReport(
            reason or (ended.reason if ended is not None else ""),
            algorithm.frame,
            run.schedule.last_frame_at,
            members,
            algorithm.failed,
            algorithm.scene.digest.hex(),
            algorithm.reached,
            dict(ended.figures) if ended is not None else {},
            run.metrics.profile(),
            _reporters(algorithm.shutdown.figures),
            [_loss(file, algorithm.frame) for file in run.files() if file.problem or file.lost],
        )


def _loss(file: FileStatus, frames: int) -> str:
    """What a file of the run lacks, and why."""
    kept = f", {frames - file.lost:,} of {counted(frames, 'frame')}" if file.lost else ""
    return f"{file.name}: {file.path}{kept} ({file.problem or 'the disk was too slow'})"


def _reporters(figures: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """The members that have reported a figure, by its name."""
    names = {name for each in figures.values() for name in each}
    return {
        name: ", ".join(sorted(who for who in figures if name in figures[who])) for name in names
    }


@fast_dataclass
class RunSummary:
    """The result of a run; members add figures of their own (`distance_driven`, ...).

    `reporters` are the members that have reported a figure, by its name.

    `incomplete` describes each output that is damaged or missing: the run has not succeeded.
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
    reporters: Mapping[str, str] = field(default_factory=dict[str, str])
    incomplete: Sequence[str] = ()

    @staticmethod
    def of(world: WorldSpec, report: EndReport, startup: Startup, failure: str) -> RunSummary:
        """The summary of a run from the last report of its coordinator."""
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
            reporters=report.reporters,
            incomplete=report.incomplete,
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
            "incomplete": list(self.incomplete),
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
        figures = dict(self.figures)
        if "late_frames" in figures and "late_frames" not in self.reporters:
            late, behind = figures.pop("late_frames"), figures.pop("seconds_behind")
            shown.append(f"  {counted(late, 'frame')} late, by {behind:.2f} s in all")
        for name, value in figures.items():
            text = f"{value:.2f}" if isinstance(value, float) else str(value)
            by = f" ({self.reporters[name]})" if name in self.reporters else ""
            # A file is no figure, and in brackets a name looks like its format.
            by = "" if isinstance(value, str) else by
            # A member in any language may report any characters.
            line = " ".join(f"{name.replace('_', ' ')}: {text}{by}".split("\n"))
            shown.append(f"  {on_screen(line)}")
        shown += [f"  {on_screen(each)}" for each in self.incomplete]
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


# --- output of members without a process of their own ---

MEMBERS: Final = "in-process"
"""The name before such lines: all members share one output, so the member is unknown."""


class AllThreads:
    """The threads of a run whose process runs nothing else."""

    def __contains__(self, thread: object) -> bool:
        return True


class _Lines(io.TextIOBase):
    """A text stream that passes on whole lines; any thread may write to it.

    `own` are threads that write to it beside the one that has opened it.
    """

    encoding = "utf-8"

    def __init__(self, tell: Callable[[str], None], own: Container[threading.Thread]) -> None:
        self.own = own
        self._tell = tell
        self._begun = ""
        # Reentrant, because `close` writes while it holds the lock.
        self._lock = threading.RLock()

    def writable(self) -> bool:
        return True

    def write(self, text: str, /) -> int:
        with self._lock:
            *lines, self._begun = (self._begun + text).split("\n")
            for line in lines:
                self._tell(line)
        return len(text)

    def close(self) -> None:
        """Pass on an unterminated last line."""
        with self._lock:
            if self._begun:
                self.write("\n")
        super().close()


class _Output(io.TextIOBase):
    """Standard output while there are runs: what a thread writes goes to its own run.

    `original` gets what threads of no run write.
    """

    def __init__(self, original: TextIO) -> None:
        self.original = original
        self.runs: dict[threading.Thread, list[_Lines]] = {}

    def __getattribute__(self, name: str) -> Any:
        # The base class has these of its own.
        if name in ("encoding", "errors", "buffer", "newlines"):
            return getattr(self.original, name)
        return super().__getattribute__(name)

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return self.original.isatty()

    def fileno(self) -> int:
        return self.original.fileno()

    def write(self, text: str, /) -> int:
        return (self._lines() or self.original).write(text)

    def flush(self) -> None:
        (self._lines() or self.original).flush()

    def _lines(self) -> _Lines | None:
        """The lines of this thread's innermost run; None if it has none."""
        thread = threading.current_thread()
        if opened := self.runs.get(thread):
            return opened[-1]
        # A copy, because runs begin and end in other threads.
        every = [lines for runs in [*self.runs.values()] for lines in [*runs]]
        return next((lines for lines in reversed(every) if thread in lines.own), None)


# Kept from step to step of a world: making and closing one takes as long as all else of `printed`.
_output_of: Final = lru_cache(1)(_Output)

_installing: Final = threading.Lock()
"""For what all threads share: standard output, and the runs of threads."""


@contextmanager
def printed(tell: Callable[[str], None], own: Container[threading.Thread] = ()) -> Generator[None]:
    """Pass to `tell`, line by line, what this thread and those of `own` print during the block."""
    thread = threading.current_thread()
    with _Lines(tell, own) as lines:
        with _installing:
            output: Any = sys.stdout
            # A program may have replaced it since another run began.
            if not isinstance(output, _Output):
                output = sys.stdout = _output_of(output)
            runs: dict[threading.Thread, list[_Lines]] = output.runs
            runs.setdefault(thread, []).append(lines)
        try:
            yield
        finally:
            with _installing:
                runs[thread].remove(lines)
                if not runs[thread]:
                    del runs[thread]
                # Nothing else may have replaced it meanwhile.
                if not runs and sys.stdout is output:
                    sys.stdout = output.original
