"""`minerva certify`: a world in all layouts, with deaths, continued and on other interpreters.

Every run is compared frame by frame with one in a single process. A check that cannot be made here
is left out with its reason; one that has no time left makes the certificate incomplete.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from minerva_bus import __version__
from minerva_bus.cli.output import FAILED, WRONG
from minerva_bus.errors import MinervaError
from minerva_bus.launch.installed import installed_worlds
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.log.record import Record
from minerva_bus.wording import counted
from minerva_determinism.determinism import world_path
from minerva_determinism.layouts import (
    ALONE,
    APART,
    KILLED,
    OMITTED,
    Layout,
    first_difference,
    laid_out,
    run_in_layout,
)
from minerva_determinism.positions import deaths
from minerva_determinism.suspects import Suspect, suspects

SAME: Final = "same"
DIFFERS: Final = "DIFFERS"
FAILS: Final = "FAILS"
LEFT_OUT: Final = "left out"
NO_TIME: Final = "no time"

MOST_LINES: Final = 12
"""Most lines about one check."""
DEADLY_FRAMES: Final = 3
"""Frames, from the first, at each of whose messages a member dies."""
DEATHS: Final = f"a death at each message of {DEADLY_FRAMES} frames"

PLAIN_PROCESSOR: Final = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-AVX2_Usable,-FMA,-FMA_Usable,-FMA4,-AVX512F",
    "OPENBLAS_CORETYPE": "Nehalem",
    "NUMBA_CPU_NAME": "generic",
}
"""Numpy, the C library, OpenBLAS and numba without the vector features of the processor."""
THREADS: Final[Mapping[str, str]] = {
    "OMP_NUM_THREADS": "4",
    "OPENBLAS_NUM_THREADS": "4",
    "NUMBA_NUM_THREADS": "4",
}

ELSEWHERE: Final = """
import sys
from pathlib import Path
from minerva_determinism.layouts import *
from minerva_determinism.positions import Killed
file = read_world_file(Path(sys.argv[1]))
run = Killed(laid_out(file, 0, left_out(file), int(sys.argv[2])))
print(*(digest.hex() for digest in run.run()))
"""
"""The digests of all frames, in one process and without a record: it runs on any interpreter."""


@dataclass(frozen=True, slots=True)
class Check:
    """A run, or many, of a world that were compared with that in one process.

    `frames` were compared in each of `runs` runs; `digest` is that of the last string.
    """

    world: str
    name: str
    result: str
    frames: int = 0
    runs: int = 1
    digest: str = ""
    seconds: float = 0.0
    lines: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        names = ("world", "name", "result", "frames", "runs", "digest", "seconds")
        return {name: getattr(self, name) for name in names} | {"lines": list(self.lines)}

    def cells(self) -> list[str]:
        """As a row of a table."""
        compared = f"{self.frames} x {self.runs}" if self.runs > 1 else str(self.frames or "")
        return [self.name, self.result, compared, self.digest[:16], f"{self.seconds:.1f}"]


TITLES: Final = ("layout", "result", "frames", "digest", "seconds")


@dataclass(slots=True)
class Certificate:
    """All checks, and by world: processes that were `omitted`, with the reasons, and `suspects`.

    Suspects are lines of its code that can make runs differ. `lengths`: the frames of a world that
    has more than were run.
    """

    checks: list[Check] = field(default_factory=list[Check])
    omitted: dict[str, dict[str, str]] = field(default_factory=dict[str, dict[str, str]])
    suspects: dict[str, list[Suspect]] = field(default_factory=dict[str, list[Suspect]])
    lengths: dict[str, int] = field(default_factory=dict[str, int])
    made: str = field(default_factory=lambda: datetime.now(UTC).isoformat(timespec="seconds"))

    @property
    def is_complete(self) -> bool:
        """Whether something was compared, and everything that was compared is the same."""
        return SAME in self.results and not self.results.keys() & {DIFFERS, FAILS, NO_TIME}

    @property
    def results(self) -> Counter[str]:
        """The number of checks by result."""
        return Counter(check.result for check in self.checks)

    @property
    def machine(self) -> str:
        """What it was made on."""
        python = f"{platform.python_implementation()} {platform.python_version()}"
        return f"Minerva Bus {__version__}, {python}, {platform.machine()}, {platform.system()}"

    def verdict(self) -> str:
        """The result in a sentence."""
        results = self.results
        compared = sum(check.frames * check.runs for check in self.checks)
        counts = ", ".join(f"{count} {result}" for result, count in sorted(results.items()))
        word = "certified" if self.is_complete else "not certified"
        longest = {check.world: check.frames for check in reversed(self.checks) if check.digest}
        parts = [
            f"; {longest.get(world, 0):,} of the {frames:,} frames of {world}"
            for world, frames in self.lengths.items()
        ]
        if omitted := sum(map(len, self.omitted.values())):
            parts.insert(0, f"; {counted(omitted, 'process')} not compared")
        return f"{word}: {counts}; {compared:,} frames compared{''.join(parts)}"

    def differs(self, world: str) -> bool:
        """Whether a check of a world has found a difference."""
        return any(check.world == world and check.result == DIFFERS for check in self.checks)

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        return {
            "certified": self.is_complete,
            "verdict": self.verdict(),
            "made": self.made,
            "machine": self.machine,
            "not_compared": self.omitted,
            "suspects": {
                world: [each.plain() for each in listed] for world, listed in self.suspects.items()
            },
            "checks": [check.plain() for check in self.checks],
        }


@dataclass(frozen=True, slots=True)
class CertificatePlan:
    """What to certify.

    Args:
        frames: of each run.
        processes: further numbers of processes for each kind of agents, for the first world.
        pythons: commands of other interpreters, in words, by the name of their check.
        until: the time on the monotonic clock at which no further check begins, seconds.
        shown: called with each check.
        begun: called with the world, the numbers of done and of all checks, and what runs now.

    """

    frames: int
    processes: Sequence[int]
    pythons: Mapping[str, Sequence[str]]
    until: float
    shown: Callable[[Check], None]
    begun: Callable[[str, int, int, str], None]


def certify(specs: Sequence[str], plan: CertificatePlan) -> Certificate:
    """Certify worlds by their files or names; none: all that are installed.

    Raises WorldFileError if there is no such world, and MisuseError if it is not a world.
    """
    made = Certificate()
    paths = {spec: world_path(spec) for spec in specs or sorted(installed_worlds())}
    for number, (spec, path) in enumerate(paths.items()):
        # Those that follow get a share of the time, too.
        now = time.monotonic()
        share = now + max(0.0, plan.until - now) / (len(paths) - number)
        with TemporaryDirectory(prefix="minerva-") as folder:
            world = _World(spec, path, plan, share, Path(folder))
            for check in world.checks(first=number == 0):
                made.checks.append(check)
                plan.shown(check)
            made.omitted[spec] = world.omitted
        file = read_world_file(path)
        made.suspects[spec] = suspects(file)
        if file.world.frames > plan.frames:
            made.lengths[spec] = file.world.frames
    return made


class _World:
    """The checks of one world. `until`: no check begins after this time."""

    def __init__(
        self, spec: str, path: Path, plan: CertificatePlan, until: float, folder: Path
    ) -> None:
        self.omitted: dict[str, str] = {}
        self._spec, self._path, self._plan, self._until = spec, path, plan, until
        self._folder = folder
        self._base = folder / "base.mcap"
        self._done = 0
        self._total = 0

    def checks(self, first: bool) -> Iterator[Check]:
        """All checks; nothing follows if the world does not run in one process."""
        began = time.monotonic()
        self._total = 3 + len([*self._layouts(first, self._plan.frames)]) + len(self._plan.pythons)
        self._begin(ALONE.name)
        done = run_in_layout(self._path, self._plan.frames, ALONE, self._base)
        if done.returncode:
            yield self._stopped(ALONE, done)
            return
        self.omitted = json.loads((self._folder / OMITTED).read_text(encoding="utf-8"))
        with Record(self._base) as record:
            self._digests = [frame.digest.hex() for frame in record.frames()]
        if not self._digests:
            yield Check(self._spec, ALONE.name, LEFT_OUT, lines=("it ends before its first frame",))
            return
        seconds = time.monotonic() - began
        count = len(self._digests)
        yield Check(self._spec, ALONE.name, SAME, count, digest=self._digests[-1], seconds=seconds)
        for number, layout in enumerate(self._layouts(first, count)):
            yield self._timed(layout.name, partial(self._run, layout, number))
        yield self._timed("recomputed from its record", self._recompute)
        yield self._timed(DEATHS, self._die)
        for name, words in self._plan.pythons.items():
            yield self._timed(name, partial(self._elsewhere, words))

    def _begin(self, name: str) -> None:
        self._plan.begun(self._spec, self._done, self._total, name)
        self._done += 1

    def _layouts(self, first: bool, count: int) -> Iterator[Layout]:
        yield Layout("one process for each member", 1, {"PYTHONHASHSEED": "1"})
        yield APART
        yield Layout("three, without vector features", 3, PLAIN_PROCESSOR)
        yield Layout("four, each with four threads", 4, THREADS)
        for processes in self._plan.processes if first else ():
            yield Layout(f"{processes} processes for each kind of agents", processes)
        yield Layout("two, and processes are killed", 2, kills=max(2, count // 10))
        yield Layout("killed, the coordinator first", 1, kills=max(2, count // 4))
        past = str(self._base)
        if early := count // 3:
            yield Layout(f"three, continued from frame {early}", 3, begin=early, past=past)
            late = 2 * early
            yield Layout(f"one process, continued from frame {late}", 0, begin=late, past=past)

    def _timed(self, name: str, check: Callable[[], Check]) -> Check:
        began = time.monotonic()
        if began >= self._until:
            return Check(self._spec, name, NO_TIME, lines=("--minutes gives it more",))
        self._begin(name)
        try:
            done = check()
        except MinervaError as error:
            done = Check(self._spec, name, FAILS, lines=_said(str(error)))
        fields = (done.result, done.frames, done.runs, done.digest)
        return Check(self._spec, name, *fields, time.monotonic() - began, done.lines)

    def _run(self, layout: Layout, number: int) -> Check:
        """A run in processes, compared by its record."""
        record = self._folder / f"{number}.mcap"
        done = run_in_layout(self._path, self._plan.frames, layout, record)
        if done.returncode:
            return self._stopped(layout, done)
        difference = first_difference(self._base, record, (ALONE.name, layout.name))
        record.unlink()
        if not difference.same:
            lines = tuple(difference.lines())[:MOST_LINES]
            return Check(self._spec, layout.name, DIFFERS, difference.frames, lines=lines)
        last, killed = self._digests[-1], _killed(self._folder / KILLED)
        if layout.kills and not killed:
            text = "it ended before a process was killed; --frames makes it longer"
            return Check(self._spec, layout.name, LEFT_OUT, difference.frames, lines=(text,))
        return Check(self._spec, layout.name, SAME, difference.frames, digest=last, lines=killed)

    def _stopped(self, layout: Layout, done: subprocess.CompletedProcess[str]) -> Check:
        """A run that ended with an error; the literal policy refuses several hosts."""
        result = LEFT_OUT if done.returncode == WRONG else FAILS
        return Check(self._spec, layout.name, result, lines=_said(done.stderr))

    def _recompute(self) -> Check:
        words = ["-m", "minerva_bus", "replay", str(self._base), str(self._path), "--recompute"]
        done = subprocess.run(  # noqa: S603
            [sys.executable, *words], capture_output=True, text=True, check=False
        )
        if done.returncode:
            result = DIFFERS if done.returncode == FAILED else FAILS
            return Check(self._spec, "", result, lines=_said(done.stdout + done.stderr))
        return Check(self._spec, "", SAME, len(self._digests), digest=self._digests[-1])

    def _die(self) -> Check:
        file = read_world_file(self._path)
        frames = min(len(self._digests), DEADLY_FRAMES + 2)
        file = laid_out(
            file, 1 if file.world.policy.rules.makes_copies else 2, self.omitted, frames
        )
        runs = 0
        for position, when, changed in deaths(file, range(DEADLY_FRAMES)):
            runs += 1
            self._plan.begun(self._spec, self._done - 1, self._total, f"{DEATHS}: {runs:,}")
            if changed is not None:
                text = f"{when} {position}: frame {changed} is the first that differs"
                return Check(self._spec, "", DIFFERS, frames, runs, lines=(text,))
            if time.monotonic() >= self._until:
                text = f"{runs} deaths were tried; --minutes gives it more"
                return Check(self._spec, "", NO_TIME, frames, runs, lines=(text,))
        return Check(self._spec, "", SAME, frames, runs)

    def _elsewhere(self, words: Sequence[str]) -> Check:
        """A run in one process of another interpreter, compared by the digests of all frames."""
        arguments = [*words, "-c", ELSEWHERE, str(self._path), str(len(self._digests))]
        try:
            done = subprocess.run(  # noqa: S603
                arguments, capture_output=True, text=True, check=False
            )
        except OSError as error:
            return Check(self._spec, "", LEFT_OUT, lines=(f"{words[0]}: {error.strerror}",))
        if done.returncode:
            # The last line of a traceback is its error.
            return Check(self._spec, "", LEFT_OUT, lines=_said(done.stderr[-500:])[-1:])
        digests = done.stdout.split()
        for frame, (here, there) in enumerate(zip(self._digests, digests, strict=False)):
            if here != there:
                text = f"frame {frame} is the first that differs: {here} here, {there} there"
                return Check(self._spec, "", DIFFERS, frame, lines=(text,))
        if len(digests) != len(self._digests):
            text = f"{counted(len(digests), 'frame')} there, {len(self._digests)} here"
            return Check(self._spec, "", DIFFERS, len(digests), lines=(text,))
        return Check(self._spec, "", SAME, len(digests), digest=digests[-1])


def _killed(path: Path) -> tuple[str, ...]:
    """Which processes were killed, if any; the next layout begins a list of its own."""
    names = path.read_text(encoding="utf-8").split() if path.exists() else []
    path.unlink(missing_ok=True)
    return (f"killed: {', '.join(names)}",) if names else ()


def _said(text: str) -> tuple[str, ...]:
    """The lines of an error, without those beyond MOST_LINES."""
    lines = text.strip().splitlines() or ["it ended without a message"]
    return tuple(lines[:MOST_LINES])
