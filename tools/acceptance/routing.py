"""The MAPF benchmark: robots of a grid reach their goals without collisions.

Each instance is the first robots of a published scenario on a published map (Stern et al. 2019:
Multi-agent pathfinding: definitions, variants, and benchmarks. SoCS). The suite reads where the
robots are from the string after each frame, and judges that without the planner.

Robots that decide from frame to frame are not sure to reach their goals all at once. Planners that
search for whole plans are: LaCAM* solves 99 % of the benchmark within 10 s (Okumura 2023: Improving
LaCAM for scalable eventually optimal multi-agent pathfinding. IJCAI).
"""

from __future__ import annotations

import time
import zipfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Suite

FRAMES = 2000
"""Frames within which all robots must be at their goals at once."""

INSTANCES = (
    ("scen-random", "empty-16-16", "random", (1, 2, 3), (50, 128)),
    ("scen-random", "random-32-32-20", "random", (1, 2, 3), (100, 200, 300)),
    ("scen-random", "random-64-64-20", "random", (1, 2, 3), (100, 500, 1000)),
    ("scen-random", "room-32-32-4", "random", (1, 2, 3), (100, 200, 300)),
    ("scen-random", "warehouse-10-20-10-2-1", "random", (1, 2, 3), (100, 500, 1000)),
    ("scen-warehouse", "warehouse-20-40-10-2-2", "10000agents", (1,), (1000, 5000, 10_000)),
)
"""Archive, map, scenario, its numbers, and numbers of robots."""

Cells = NDArray[np.int64]


def _results(folder: Path) -> Iterator[Result]:
    for archive, name, kind, numbers, sizes in INSTANCES:
        for number, size in product(numbers, sizes):
            starts, goals = _scenario(folder, archive, f"{name}-{kind}-{number}.scen", size)
            rows = (folder / "map" / f"{name}.map").read_text(encoding="utf-8").splitlines()[4:]
            yield played(f"{name} {number}, {size:,} robots", rows, starts, goals)


def _scenario(folder: Path, archive: str, scenario: str, size: int) -> tuple[Cells, Cells]:
    """Starts and goals of the first robots of a scenario: x and y, shape (robots, 2)."""
    path = folder / "scen" / f"{archive}.zip"
    if not path.exists():
        raise MissingSuiteError(f"no {path}")
    with zipfile.ZipFile(path) as archived:
        text = archived.read(f"{archive}/{scenario}").decode()
    lines = text.splitlines()[1 : size + 1]
    places = np.array([line.split("\t")[4:8] for line in lines], np.int64)
    return places[:, :2], places[:, 2:]


def played(case: str, rows: list[str], starts: Cells, goals: Cells) -> Result:
    """The result of an instance: its first collision fails it.

    The first frame, in which the robots show where they are, counts as the others do.
    """
    from tools.acceptance import fleet  # numba

    free = np.array([[cell in ".G" for cell in row] for row in rows])
    before, seconds, problem = starts, 0.0, ""
    costs = (starts != goals).any(axis=1).astype(int)  # frames until a robot is at its goal to stay
    with fleet.world(rows, starts, goals).start(seed=1) as live:
        frame = 0
        while frame < FRAMES and (before != goals).any() and not problem:
            began = time.perf_counter()
            live.step()
            # The first frames wait for the compiler and the lengths of paths.
            seconds += time.perf_counter() - began if frame > 1 else 0.0
            frame = live.frame
            after = _places(live.agents(fleet.Robot))
            problem = next(collisions(free, before, after), "")
            costs[(after != goals).any(axis=1)] = frame + 1
            before = after
    arrived = int((before == goals).all(axis=1).sum())
    least = fleet.Control(rows).lengths(starts, goals)
    solved = arrived == len(goals)
    figures = {
        "at their goals": f"{arrived:,}",
        "makespan": f"{frame:,}",
        "longest path": f"{least.max():,}",
        "sum of costs": f"{costs.sum():,}",
        "/ shortest paths": f"{costs.sum() / least.sum():.2f}",
        "frames/s": f"{(frame - 2) / seconds:.0f}",
    }
    if problem:
        return Result(case, Outcome.FAILED, f"frame {frame}: {problem}", figures)
    if not solved:
        reason = f"not all robots are at their goals at once within {FRAMES:,} frames"
        return Result(case, Outcome.EXPECTED, reason, figures)
    return Result(case, Outcome.PASSED, "", figures)


def _places(robots: Any) -> Cells:
    return np.stack([robots["x"], robots["y"]], axis=1)


def collisions(free: NDArray[np.bool_], before: Cells, after: Cells) -> Iterator[str]:
    """What no robot may do in a frame."""
    (width, robots), (x, y) = (free.shape[1], len(after)), after.T
    if not (free[y, x].all() and (x >= 0).all() and (y >= 0).all()):
        yield "a robot is in a wall"
    if (np.abs(after - before).sum(axis=1) > 1).any():
        yield "a robot has gone further than to the next cell"
    old, new = before[:, 1] * width + before[:, 0], y * width + x
    if len(np.unique(new)) < robots:
        yield "two robots are in a cell"
    moved = old != new
    ways = set(zip(old[moved].tolist(), new[moved].tolist(), strict=True))
    if any((end, start) in ways for start, end in ways):
        yield "two robots have changed places"


MAPF = Suite(
    "mapf",
    "Kei18/lacam3",
    "scripts",
    "routing of up to 10,000 robots on grids: no two in a cell, none change places",
    _results,
)
