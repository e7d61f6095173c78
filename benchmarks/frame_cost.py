"""CPU time and function calls per frame of an empty lockstep, for a given source tree.

    PYTHON benchmarks/frame_cost.py TREE WORKERS STEPS [--calls]

Runs the tree's own `benchmarks.lockstep` in this process and imports nothing else from it, so that
trees with different module names can be measured too. Prints one line of JSON.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import statistics
import sys
import time
from cProfile import Profile
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any


class Samples:
    """Times at the end of each frame in one thread, or with `calls` the function calls.

    `call` is called once per frame. The profiler distorts times, so a run measures only one of the
    two.
    """

    def __init__(self, skip: int, calls: bool) -> None:
        self._skip = skip
        self._profile = Profile() if calls else None
        self._times: list[tuple[float, float]] = []
        self.count = 0

    def call(self) -> None:
        """Take a sample; the first `skip` frames are the warm-up."""
        self.count += 1
        if self._profile is not None and self.count == self._skip:
            self._profile.enable()
        elif self.count >= self._skip:
            self._times.append((time.perf_counter(), time.thread_time()))

    def figures(self) -> dict[str, float]:
        """Medians per frame in microseconds, or the mean number of calls."""
        if self._profile is not None:
            self._profile.disable()
            entries: list[Any] = self._profile.getstats()
            calls = sum(entry.callcount for entry in entries)
            # Two to four of these calls are from `call` itself.
            return {"calls": calls / max(1, self.count - self._skip)}
        wall, cpu = zip(*self._times, strict=True)
        return {"us_wall": _median_step(wall), "us_cpu": _median_step(cpu)}


def _median_step(times: tuple[float, ...]) -> float:
    return 1e6 * statistics.median(b - a for a, b in pairwise(times))


def measure(workers: int, steps: int, calls: bool) -> dict[str, float]:
    """Costs of the coordinator and, with the prefix `member_`, of one member."""
    lockstep: Any = importlib.import_module("benchmarks.lockstep")
    warm_up: int = lockstep.WARM_UP
    coordinator = Samples(warm_up, calls)
    member = Samples(warm_up, calls)
    read, write = os.pipe()

    def end_of_frame() -> float:
        coordinator.call()
        return time.perf_counter()

    def generate(service: Any, tick: Any) -> tuple[()]:
        member.call()
        if member.count == warm_up + steps - 1 and service.reports:
            os.write(write, json.dumps(member.figures()).encode() + b"\n")
        return ()

    def idle(name: str) -> Any:
        made = plain_idle(name)
        made.service.reports = name.endswith("-0")
        return made

    # The benchmark reads its clock at the start, and then once at the end of each frame.
    lockstep.time = SimpleNamespace(perf_counter=end_of_frame)
    plain_idle, lockstep.idle = lockstep.idle, idle
    lockstep.Idle.generate = generate
    lockstep.minerva(workers, steps)
    figures = coordinator.figures()
    with os.fdopen(read) as pipe:
        reported = json.loads(pipe.readline())
    return {**figures, **{f"member_{name}": amount for name, amount in reported.items()}}


def main() -> None:
    """Measure a tree, and print one line of JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tree", type=Path, help="the folder of a source tree")
    parser.add_argument("workers", type=int, help="members of the lockstep")
    parser.add_argument("steps", type=int, help="frames that are measured")
    parser.add_argument("--calls", action="store_true", help="calls instead of times")
    given = parser.parse_args()
    if not (given.tree / "benchmarks" / "lockstep.py").is_file():
        parser.error(f"{given.tree} has no benchmarks/lockstep.py; give the folder of a tree")
    if given.workers < 1 or given.steps < 1:
        parser.error("workers and steps must be at least 1")
    sys.path[0] = str(given.tree)
    print(json.dumps(measure(given.workers, given.steps, given.calls)))


if __name__ == "__main__":
    main()
