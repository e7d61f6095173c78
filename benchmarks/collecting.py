"""Memory and time of collecting a large population into a Parquet file.

    python -m benchmarks.collecting [--agents 1000000] [--frames 10 100]

Each number of frames runs in a new process. Peak memory must not depend on it.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from minerva_bus import Agent, EventType, World, each, on, run

eStep = EventType("eStep")


class Walker(Agent, symbol="AWalker"):
    x: float = 0.0
    steps: int = 0

    @on("eStep", population=True)
    def walk(self, step, moment):
        self.x = self.x + 0.1
        self.steps = self.steps + 1


def collect(agents: int, frames: int, path: Path) -> None:
    """Run the world, and print duration, peak memory and file size."""
    world = World(Walker.many("w", agents, x=np.arange(agents) * 0.5), services=[each(eStep)])
    began = time.perf_counter()
    run(world, frames=frames, collect=[Walker.x, Walker.steps], into=path)
    seconds = time.perf_counter() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    size = path.stat().st_size / 1e6
    print(f"{agents:,} agents, {frames} frames: {seconds:.1f} s, {peak:.0f} MB at most,"
          f" file {size:.0f} MB")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--agents", type=int, default=1_000_000)
    parser.add_argument("--frames", type=int, nargs="+", default=[10, 100])
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    for frames in given.frames:
        if given.here:
            with tempfile.TemporaryDirectory() as folder:
                collect(given.agents, frames, Path(folder) / "walkers.parquet")
        else:
            words = ["--agents", str(given.agents), "--frames", str(frames), "--here"]
            subprocess.run([sys.executable, "-m", "benchmarks.collecting", *words], check=True)


if __name__ == "__main__":
    main()
