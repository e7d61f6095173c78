"""Cost of a record: frames per second with and without one, in turns within one run.

    python -m benchmarks.recording [--worlds walkers meadow robot robots drops] [--turns 5] [--json]

Each turn runs a world on the bus at full speed, once without a record and once with one, in
alternating order: sixteen agents that only move, a meadow with about seventy, the robot, sixteen
robots, and a million agents with one number each, which changes in each frame. The rates are
medians over all turns, and the cost is the median of the costs of the turns. The second half of the
table is the CPU time of all processes of a run, including its start; it is more reliable on a busy
machine. `MB/s` is the size of the record by the time of its frames.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks import limits
from benchmarks.command import options

MINERVA = (sys.executable, "-m", "minerva_bus.cli.main", "run")
ROOT = Path(__file__).parents[1]
NAMES = ("walkers", "meadow", "robot", "robots", "drops")
WALKERS = f"""
[world]
vocabulary = "walkers:vocabulary"
string = "{" · ".join(f"AWalker#w{n}<x={n}>" for n in range(16))}"
seed = 7

[process.steps]
service = "each"
event = "eStep"

[process.walkers]
agents = "walkers:Walker"
processes = 2
"""


@dataclass(frozen=True, slots=True)
class Kind:
    """A world to measure: its name, its number of frames, and its options."""

    name: str
    frames: int
    words: tuple[str, ...] = ()


def kinds(folder: Path) -> dict[str, Kind]:
    """The worlds by name; writes the one of sixteen walkers into a folder."""
    models = Path(__file__).parent / "models"
    (folder / "walkers.py").write_text((models / "walkers.py").read_text(encoding="utf-8"))
    (folder / "walkers.toml").write_text(WALKERS, encoding="utf-8")
    (folder / "drops.toml").write_text(
        limits.WORLD.format(agents=1_000_000, sends="false") + limits.AGENTS, encoding="utf-8"
    )
    robots = str(ROOT / "worlds/minerva_worlds/robots/robots.toml")
    return {
        "walkers": Kind(str(folder / "walkers.toml"), 2000),
        "meadow": Kind(str(ROOT / "worlds/minerva_worlds/meadow/meadow.toml"), 1000),
        "robot": Kind("robot", 300, ("--until", "")),
        "robots": Kind(robots, 60, ("--robots", "16", "--until", "")),
        "drops": Kind(str(folder / "drops.toml"), 50),
    }


@dataclass(frozen=True, slots=True)
class Run:
    """Results of one run: frames per second, and CPU time of all processes in ms per frame."""

    rate: float
    work: float
    megabytes_per_s: float


def run(kind: Kind, folder: Path, *more: str) -> Run:
    """Run a world once, including its start and end."""
    words = [*MINERVA, kind.name, "--json", "--quiet", "--rate", "0", *kind.words]
    before = os.times()
    done = subprocess.run(
        [*words, "--frames", str(kind.frames), *more],
        cwd=folder,
        env={**os.environ, "MINERVA_RUNTIME_DIR": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    after = os.times()
    if done.returncode:
        sys.exit(f"{kind.name}: {done.stderr.strip()}")
    used = after.children_user + after.children_system
    used -= before.children_user + before.children_system
    rate = float(json.loads(done.stdout)["frames_per_second"])
    written = sum(file.stat().st_size for file in folder.glob("run.mcap*"))
    return Run(rate, 1000 * used / kind.frames, 1e-6 * written * rate / kind.frames)


def turn(kind: Kind, folder: Path, number: int) -> tuple[Run, Run]:
    """One run without and one with a record; `number` alternates their order."""
    recorded = ("--record", str(folder / "run.mcap"))
    if number % 2:
        with_one = run(kind, folder, *recorded)
        return run(kind, folder), with_one
    return run(kind, folder), run(kind, folder, *recorded)


def main() -> None:
    """Measure in turns and print a table."""
    arguments = options(__doc__, worlds=[*NAMES], turns=5)
    if not arguments.json:
        print(f"{'':10} {'frames a second':^27}   {'ms of work a frame':^27}")
        print(f"{'world':10}" + 2 * f" {'without':>9} {'with':>9} {'cost':>7}  " + "   MB/s")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for world in arguments.worlds:
            report(world, kinds(folder)[world], folder, arguments)


def report(world: str, kind: Kind, folder: Path, arguments: argparse.Namespace) -> None:
    """Measure and print one world."""
    turns = [turn(kind, folder, number) for number in range(arguments.turns)]
    rates = [statistics.median(turn.rate for turn in rounds) for rounds in zip(*turns, strict=True)]
    works = [statistics.median(turn.work for turn in rounds) for rounds in zip(*turns, strict=True)]
    slower = statistics.median(1 - second.rate / first.rate for first, second in turns)
    more = statistics.median(second.work / first.work - 1 for first, second in turns)
    written = statistics.median(second.megabytes_per_s for _, second in turns)
    if arguments.json:
        row = {"rates": rates, "slower": slower, "work": works, "more": more, "MB/s": written}
        print(json.dumps({"world": world, **row}), flush=True)
    else:
        columns = ((rates, slower), (works, more))
        cells = [f" {a:9.2f} {b:9.2f} {100 * cost:6.1f}%  " for (a, b), cost in columns]
        print(f"{world:10}" + "".join(cells) + f"{written:7.1f}", flush=True)


if __name__ == "__main__":
    main()
