"""Memory and time of tables of a large population: collected while it runs, or exported later.

    python -m benchmarks.collecting [--agents 1000000] [--frames 10 100] [--export] [--json]

Each number of frames runs in a new process, which writes two attributes of each agent to a Parquet
file. Peak memory must not depend on the number of frames. With --export, the world is recorded
first, and the table is made of its record.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.command import Option, Table, options
from benchmarks.forked import task
from minerva_analysis import export
from minerva_bus import Agent, EventType, World, each, on, run

COLUMNS = {"": "<8", "frames": ">6.0f", "s": ">7.1f", "CPU s": ">7.1f", "peak MB": ">8.0f",
           "file MB": ">8.0f"}  # fmt: skip
eStep = EventType("eStep")


class Walker(Agent, symbol="AWalker"):
    x: float = 0.0
    steps: int = 0

    @on("eStep", population=True)
    def walk(self, step, moment):
        self.x = self.x + 0.1
        self.steps = self.steps + 1


ATTRIBUTES = ("x", "steps")


def walkers(agents: int) -> World:
    """A world of this many walkers."""
    return World(Walker.many("w", agents, x=np.arange(agents) * 0.5), services=[each(eStep)])


def collect(agents: int, frames: int, folder: Path) -> Path:
    """Run the world and collect; returns the table's file."""
    path = folder / "collected.parquet"
    run(walkers(agents), frames=frames, collect=[Walker.x, Walker.steps], into=path)
    return path


def record(agents: int, frames: int, folder: Path) -> Path:
    """Run and record the world; returns the record."""
    path = folder / "walkers.mcap"
    run(walkers(agents), frames=frames, record=path)
    return path


def make_table(agents: int, frames: int, folder: Path) -> Path:
    """Make the table of the record; returns its file."""
    path = folder / "exported.parquet"
    entries = {name: f"AWalker.{name}" for name in ATTRIBUTES}
    done = export(folder / "walkers.mcap", collect=entries, into=path)
    if done.missing:
        sys.exit(f"the record lacks {len(done.missing)} ranges of frames: the disk is too slow")
    return path


STEPS: dict[str, Callable[[int, int, Path], Path]] = {
    "collect": collect,
    "record": record,
    "export": make_table,
}


def measured(name: str, agents: int, frames: int, folder: Path) -> dict[str, float | str]:
    """Time, peak memory and file of one step, in this process."""
    began, worked = time.perf_counter(), time.process_time()
    path = STEPS[name](agents, frames, folder)
    return {
        "step": name,
        "frames": frames,
        "seconds": time.perf_counter() - began,
        # Depends less on other programs.
        "cpu_seconds": time.process_time() - worked,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "file_mb": path.stat().st_size / 1e6,
    }


def main() -> None:
    """Print a row for each number of frames and step."""
    given = options(
        __doc__,
        agents=1_000_000,
        frames=[10, 100],
        export=Option(False, "record the world, and make the table of its record"),
        task=Option(str, "run one step in this process, for the benchmark itself"),
        folder=Option(Path, "of the files of --task"),
    )
    if given.task:
        Table({}, as_json=True).row(
            measured(given.task, given.agents, given.frames[0], given.folder)
        )
        return
    table = Table(COLUMNS, as_json=given.json)
    for frames in given.frames:
        with tempfile.TemporaryDirectory() as folder:
            for step in ("record", "export") if given.export else ("collect",):
                words = step, "--agents", given.agents, "--frames", frames, "--folder", folder
                table.row(task("benchmarks.collecting", *words))


if __name__ == "__main__":
    sys.exit(main())
