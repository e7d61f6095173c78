"""CPU time that each region costs the coordinator of a world, and what follows for more regions.

    python -m benchmarks.region_costs [--regions 4 16 64] [--agents 10] [--json]

Coordinator and regions run in this process and exchange messages as bytes, as with processes
(minerva_bus/testing/simulation/cluster.py), so Zenoh's time is not included. The world is that of
benchmarks.regions with `agents` in each region. The fastest frame counts, because other processes
can only slow it down. Rows marked * are predictions: times grow as
between the two largest measured numbers, and `request bytes` are those of one frame to all regions
if each sends a parcel to four others.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Final

import numpy as np

from benchmarks.command import Option, Table, options
from benchmarks.regions import world
from minerva_bus.launch.compiling import compile_agents, no_progress
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.regions.layout import in_regions
from minerva_bus.settings.overrides import Overrides
from minerva_bus.testing.simulation.cluster import Cluster

if TYPE_CHECKING:
    from minerva_bus.frame import stimuli as s

COLUMNS: Final = {"regions": ">8", "coordinator ms": ">15.2f", "a region ms": ">12.2f",
                  "frames/s at most": ">17.1f", "request bytes": ">14,"}  # fmt: skip
PREDICTED: Final = 16, 256, 4096
NEIGHBOURS: Final = 4
PAIR_BYTES: Final = 4
WARM_UP: Final = 3


def measured(path: Path, regions: int, frames: int) -> tuple[float, float]:
    """CPU milliseconds of the coordinator, and of one region, each in its fastest frame."""
    file = read_world_file(path, Overrides(frames=frames + WARM_UP))
    compile_agents(file.processes, no_progress)
    rows: list[tuple[float, float]] = []
    used, begin, done = 0.0, time.process_time(), 0
    with in_regions(file) as processes:
        cluster = Cluster(processes, Random(1))
        handle = cluster.runner.handle

        def timed(stimulus: s.Stimulus) -> None:
            nonlocal used
            before = time.process_time()
            handle(stimulus)
            used += time.process_time() - before

        def note(_: Cluster) -> None:
            nonlocal used, begin, done
            if len(cluster.done) == done:
                return
            whole = time.process_time() - begin
            rows.append((1e3 * used, 1e3 * (whole - used) / regions))
            used, begin, done = 0.0, time.process_time(), len(cluster.done)

        cluster.runner.handle = timed
        cluster.run(note)
    coordinator, each = zip(*rows[WARM_UP:], strict=True)
    return min(coordinator), min(each)


def main() -> None:
    """Print a row for each number of regions, and the predictions."""
    given = options(
        __doc__, regions=[4, 16, 64], agents=Option(10, "in each region"), frames=30
    )  # fmt: skip
    table, times = Table(COLUMNS, as_json=given.json), dict[int, tuple[float, float]]()
    with tempfile.TemporaryDirectory() as folder:
        for count in given.regions:
            path = world(Path(folder), count * given.agents, 0, count)
            times[count] = measured(path, count, given.frames)
            table.row(_row(str(count), count, *times[count]))
    last = sorted(times)[-2:]
    if len(last) < 2:
        return
    before, after = np.array([times[count] for count in last])
    # Of few frames, more regions may seem to cost less.
    slopes = np.maximum(0.0, (after - before) / (last[1] - last[0]))
    for count in PREDICTED:
        table.row(_row(f"{count}*", count, *(after + slopes * (count - last[1]))))


def _row(name: str, count: int, coordinator: float, region: float) -> dict[str, object]:
    return {
        "regions": name,
        "coordinator ms": float(coordinator),
        "a region ms": float(region),
        "frames/s at most": 1e3 / float(coordinator),
        "request bytes": PAIR_BYTES * NEIGHBOURS * count * count,
    }


if __name__ == "__main__":
    main()
