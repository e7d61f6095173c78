"""Key figures of the kernel, compared with an older revision in alternating turns.

    python -m benchmarks.guard [REV] [--turns 5] [--figures lockstep latency ...] [--json]

The older revision, by default `main`, is installed in a temporary worktree, and each of the two
runs its own benchmarks; a figure that the older one lacks is left out with a reason. All figures
are times or costs, so less is better. A figure is slower if it is more than SLOWER times that of
the older revision, both by the minima over all turns and by the median of the ratios of each turn.
What seems slower is measured once more, because a busy machine may move both. The lockstep of
BAR_WORKERS processes must also take at most BAR times as long as that of bare Zenoh, whose script
is in --peers. The exit code is 1 if a figure is slower or the bar is missed.
"""

from __future__ import annotations

import json
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.command import ENVIRONMENT, PEERS_FOLDER, Option, Table
from benchmarks.command import options as parsed
from benchmarks.lockstep import peer
from tools.without import install

ROOT: Final = Path(__file__).parents[1]
SLOWER: Final = 1.1
BAR: Final = 1.25
BAR_WORKERS: Final = 8
WORKERS: Final = (1, 2, 8, 16)
STEPS: Final = 1000
FIRST_FRAME: Final = (
    "minerva_bus.cli.main", "run", "robot", "--name", "first-frame", "--frames", 1, "--quiet",
)  # fmt: skip
COLUMNS: Final = {
    "figure": "<24",
    "before": ">10.4g",
    "now": ">10.4g",
    "ratio": ">6.2f",
    "of turns": ">8.2f",
    "bare": ">7.2f",
    "": "<6",
}


@dataclass(frozen=True, slots=True)
class Revision:
    """A revision of the project: its folder, and a Python in which it is installed."""

    folder: Path
    python: Path

    def rows(self, module: str, *words: object) -> list[Any]:
        """The lines of JSON that a benchmark of this revision prints. Raises LookupError."""
        done = self._run(module, *words)
        rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        if not rows:
            reason = done.stderr.strip().rpartition("\n")[2]
            raise LookupError(f"{module}: {done.returncode}: {reason}")
        return rows

    def cpu_seconds(self, module: str, *words: object) -> float:
        """The CPU time of a command with all of its processes."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        self._run(module, *words)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def _run(self, module: str, *words: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.python, "-m", module, *map(str, words)],
            cwd=self.folder, env=ENVIRONMENT, capture_output=True, text=True, timeout=600,
            check=False,
        )  # fmt: skip


Figures = dict[str, float]


def lockstep(revision: Revision) -> Figures:
    """µs of an empty frame on the bus, by the number of members."""
    taken = {k: revision.rows("benchmarks.lockstep", "--task", k, STEPS)[-1] for k in WORKERS}
    return {f"lockstep of {k}, µs": row["us_per_step_median"] for k, row in taken.items()}


def latency(revision: Revision) -> Figures:
    """µs from an event to its view, or to the view of what it changes."""
    rows = revision.rows("benchmarks.latency", "--events", 300, "--turns", 1, "--json")
    return {f"event to {row['system']}, µs": row["us"] for row in rows if row["system"] != "zenoh"}


def frames(revision: Revision) -> Figures:
    """µs of a frame in one process."""
    rows = revision.rows("benchmarks.frames", "--frames", 1000, "--turns", 1, "--json")
    return {f"frame with {row['frame']}, µs": row["us"] for row in rows}


def agents(revision: Revision) -> Figures:
    """ms of a step of 1,000 birds in one process."""
    words = ("--model", "flock", "--agents", 1000, "--in-process", "--systems", "minerva")
    rows = revision.rows("benchmarks.populations", *words, "--turns", 1, "--json")
    return {"1,000 agents, ms": 1e3 / rows[-1]["frames_per_s"]}


def start(revision: Revision) -> Figures:
    """Seconds until the first frame of the robot, and of CPU time for it and for the version."""
    rows = revision.rows("benchmarks.startup", "--systems", "robot", "--turns", 1, "--json")
    return {
        "first frame, s": rows[0]["seconds"],
        "first frame, s of CPU": revision.cpu_seconds(*FIRST_FRAME),
        "--version, s of CPU": revision.cpu_seconds("minerva_bus.cli.main", "--version"),
    }


def record(revision: Revision) -> Figures:
    """ms of CPU time of a recorded frame, in all processes."""
    rows = revision.rows("benchmarks.recording", "--worlds", "meadow", "--turns", 1, "--json")
    return {"recorded frame, ms": rows[-1]["work"][1]}


GROUPS: Final[dict[str, Callable[[Revision], Figures]]] = {
    measure.__name__: measure for measure in (lockstep, latency, frames, agents, start, record)
}


@contextmanager
def installed(name: str) -> Iterator[Revision]:
    """A revision in a temporary worktree. Raises CalledProcessError if git does not know it."""
    with tempfile.TemporaryDirectory(prefix="minerva-guard-") as parent:
        folder = Path(parent, "old")
        git = ["git", "-C", ROOT, "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", folder, name], check=True)
        try:
            yield Revision(folder, install(folder))
        finally:
            subprocess.run([*git, "remove", "--force", folder], check=True)


class Comparison:
    """The figures of both revisions, and those of bare Zenoh, by turn."""

    def __init__(self) -> None:
        self._turns: dict[str, list[tuple[float, float]]] = {}
        self._groups: dict[str, str] = {}
        self._bare: list[float] = []

    def add(self, group: str, before: Figures, now: Figures) -> None:
        """Add the figures of a turn."""
        for name in before.keys() & now.keys():
            self._groups[name] = group
            self._turns.setdefault(name, []).append((before[name], now[name]))

    def add_bare(self, peers: Path) -> None:
        """Measure bare Zenoh once, if its script is there."""
        result = peer("zenoh", peers, BAR_WORKERS, STEPS)
        if isinstance(result, str):
            print(f"bare Zenoh is left out: {result}", file=sys.stderr)
        else:
            self._bare.append(result["us_per_step_median"])

    def suspects(self) -> list[str]:
        """The groups in which a figure is slower, or misses the bar."""
        return sorted({self._groups[row["figure"]] for row in self.rows() if row["wrong"]})

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row for each figure, with what is wrong with it."""
        for name, turns in sorted(self._turns.items()):
            before, now = map(min, zip(*turns, strict=True))
            ratio, of_turns = now / before, statistics.median(new / old for old, new in turns)
            bar = bool(self._bare) and name == f"lockstep of {BAR_WORKERS}, µs"
            bare = now / min(self._bare) if bar else None
            slower = min(ratio, of_turns) > SLOWER
            wrong = "slower" if slower else "bar" if bare is not None and bare > BAR else ""
            yield {
                "figure": name, "before": before, "now": now, "ratio": ratio,
                "of_turns": of_turns, "bare": bare, "wrong": wrong,
            }  # fmt: skip


def measured(group: str, revision: Revision) -> Figures:
    """The figures of a group; none, with a message, if this revision does not have them."""
    try:
        return GROUPS[group](revision)
    except (LookupError, subprocess.TimeoutExpired) as error:
        print(f"{group} is left out: {error}", file=sys.stderr)
        return {}


def main() -> int:
    """Measure in turns, print a table, and return the exit code."""
    words = sys.argv[1:]
    name = words.pop(0) if words and not words[0].startswith("-") else "main"
    arguments = parsed(
        __doc__, words, turns=5, figures=Option(list(GROUPS), choices=GROUPS), peers=PEERS_FOLDER
    )
    comparison = Comparison()
    now = Revision(ROOT, Path(sys.executable))
    with installed(name) as before:
        groups: list[str] = arguments.figures
        # What seems slower is measured once more, and all turns count.
        for _ in range(2):
            for number in range(arguments.turns):
                for group in [*groups]:
                    # The order alternates, because a benchmark warms caches for the next one.
                    pair = (before, now) if number % 2 else (now, before)
                    taken = {each: measured(group, each) for each in pair}
                    if not taken[now]:
                        return 1
                    if not taken[before]:
                        groups.remove(group)
                    comparison.add(group, taken[before], taken[now])
                    if group == "lockstep":
                        comparison.add_bare(arguments.peers)
            groups = comparison.suspects()
    table = Table(COLUMNS, as_json=arguments.json)
    rows = list(comparison.rows())
    for row in rows:
        table.row(row)
    return int(not rows or any(row["wrong"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
