"""Runs per second of a batch: `sweep` beside Mesa's `batch_run`, the same model and processes.

    python -m extensions.study.benchmarks.batches
        [--runs 1000] [--frames 50] [--processes 2] [--turns 3] [--json]

The model is the SIR model of examples/sir, 200 people, with its two curves. In each turn both
systems run the batch in a new process, one after the other, with the table at the end. It is wall
time with all starts and imports, CPU that of all processes. Compare the ratios: the time of Mesa
divided by ours.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from benchmarks.command import Option, Table, options

ROOT: Final = Path(__file__).parents[3]
SYSTEMS: Final = {"Minerva Bus": "our_batch", "Mesa": "mesa_batch"}
COLUMNS: Final = {"system": "<12", "runs/s": ">8.1f", "wall s": ">8.1f", "CPU s": ">8.1f",
                  "ratio": ">6.2f", "CPU ratio": ">9.2f"}  # fmt: skip


def batch(function: str, runs: int, frames: int, processes: int) -> tuple[float, float]:
    """Wall and CPU seconds of a batch in a new process."""
    code = (
        f"from extensions.study.benchmarks.epidemic import {function}\n"
        f"if __name__ == '__main__': print({function}({runs}, {frames}, {processes}))"
    )
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    # Mesa has a row less: it collects the last step only.
    if done.returncode or int(done.stdout) < runs * frames:
        sys.exit(f"{function}: {done.stdout[-200:]}\n{done.stderr[-800:]}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    given = options(
        __doc__, runs=1000, turns=3, processes=2, frames=Option(50, "frames of each run")
    )  # fmt: skip
    seconds: dict[str, list[tuple[float, float]]] = {system: [] for system in SYSTEMS}
    for _ in range(given.turns):
        for system, function in SYSTEMS.items():
            seconds[system].append(batch(function, given.runs, given.frames, given.processes))
    medians = {
        system: [statistics.median(values) for values in zip(*turns, strict=True)]
        for system, turns in seconds.items()
    }
    table = Table(COLUMNS, as_json=given.json)
    ours = medians["Minerva Bus"]
    for system, (wall, cpu) in medians.items():
        table.row({"system": system, "runs_per_second": given.runs / wall, "wall_s": wall,
                   "cpu_s": cpu, "ratio": wall / ours[0], "cpu_ratio": cpu / ours[1]})  # fmt: skip


if __name__ == "__main__":
    main()
