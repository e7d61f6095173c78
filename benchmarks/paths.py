"""Costs of planning on large maps: clearance, shortest paths and the initial string.

    python -m benchmarks.paths [--size 512] [--json]

Paths are compared with a textbook A* (a heap, one cell at a time) on clutter in which each cell is
blocked with a given probability. Each measurement of memory runs in a separate process.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable
from functools import partial
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import Option, options
from minerva_agents.robot.grid import clearance
from minerva_agents.robot.planning import shortest_path
from minerva_agents.robot.world import defaults, scene

_DIAGONAL = math.sqrt(2.0)
_MOVES = tuple(
    (down, across, _DIAGONAL if down and across else 1.0)
    for down in (-1, 0, 1)
    for across in (-1, 0, 1)
    if down or across
)


def plain_length(blocked: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> float:
    """Length of a shortest path by A* over cells with the octile distance as heuristic."""
    walls = np.pad(blocked, 1, constant_values=True).tolist()
    end = goal[0] + 1, goal[1] + 1
    cell = start[0] + 1, start[1] + 1
    costs, settled = {cell: 0.0}, set()
    queue = [(_octile(cell, end), cell)]
    while queue:
        _, cell = heappop(queue)
        if cell == end:
            return costs[cell]
        if cell in settled:
            continue
        settled.add(cell)
        row, column = cell
        for down, across, length in _MOVES:
            if walls[row + down][column + across]:
                continue
            if down and across and (walls[row][column + across] or walls[row + down][column]):
                continue
            to = row + down, column + across
            cost = costs[cell] + length
            if cost < costs.get(to, math.inf):
                costs[to] = cost
                heappush(queue, (cost + _octile(to, end), to))
    return math.inf


def _octile(cell: tuple[int, int], goal: tuple[int, int]) -> float:
    down, across = abs(cell[0] - goal[0]), abs(cell[1] - goal[1])
    return max(down, across) + (_DIAGONAL - 1.0) * min(down, across)


def clutter(size: int, density: float) -> tuple[np.ndarray, tuple[int, int], tuple[int, int]]:
    """A square map with a share of blocked cells, and two distant free cells."""
    blocked = np.random.default_rng(5).random((size, size)) < density
    start, goal = (2, 2), (size - 3, size - size // 10)
    blocked[start] = blocked[goal] = False
    return blocked, start, goal


def _length(blocked: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> float:
    path = shortest_path(blocked, start, goal)
    return math.inf if path is None else path.length


def measured(work: Callable[[], float]) -> tuple[float, float, float]:
    """The result of `work`, its seconds, and the increase of peak memory in MB."""
    receiver, sender = multiprocessing.get_context("fork").Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=_measure, args=(work, sender))
    child.start()
    made = receiver.recv()
    child.join()
    return made


def _measure(work: Callable[[], float], sender: Any) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.perf_counter()
    result = work()
    seconds = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sender.send((result, seconds, (after - before) / 1024))


def paths(size: int) -> list[dict[str, float]]:
    """Lengths, seconds and megabytes on clutter for both planners."""
    rows: list[dict[str, float]] = []
    for density in (0.0, 0.1, 0.2, 0.3):
        blocked, start, goal = clutter(size, density)
        ours = measured(partial(_length, blocked, start, goal))
        plain = measured(partial(plain_length, blocked, start, goal))
        if not math.isclose(ours[0], plain[0], rel_tol=1e-9):
            raise AssertionError(f"lengths differ: {ours[0]} and {plain[0]}")
        names = ("length", "seconds", "megabytes")
        row: dict[str, float] = {"density": density, **dict(zip(names, ours, strict=True))}
        rows.append(row | {"plain_seconds": plain[1], "plain_megabytes": plain[2]})
    return rows


def distances(size: int) -> dict[str, float]:
    """Seconds for the clearance of an empty square hall."""
    walls = np.pad(np.zeros((size, size), np.bool_), 1, constant_values=True)
    return {"size": size, "seconds": measured(lambda: float(clearance(walls).max()))[1]}


def start(width: int, height: int) -> dict[str, float]:
    """Seconds from the map of a hall with pillars to the checked options and initial string."""
    image = np.full((height, width), 254, np.uint8)
    image[:3] = image[-3:] = 0
    image[:, :3] = image[:, -3:] = 0
    image[50:-50:100, 50:-50:100] = 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hall.pgm"
        file.write_bytes(b"P5\n%d %d\n255\n" % (width, height) + image.tobytes())
        options = {"map": str(file), "cell": 0.05 * math.ceil(max(width, height) / 900)}
        seconds = measured(lambda: float(len(scene(defaults(options)))))[1]
    return {"width": width, "height": height, "seconds": seconds}


def main() -> None:
    """Measure and print."""
    asked = options(__doc__, size=Option(512, "cells along a side of the clutter"))
    made = {
        "paths": paths(asked.size),
        "clearance": [distances(size) for size in (500, 1000, 2000, 4000)],
        "start": [start(1730, 1300), start(4000, 4000)],
    }
    print(json.dumps(made, indent=2) if asked.json else _table(made))


def _table(made: dict[str, list[dict[str, float]]]) -> str:
    lines: list[str] = []
    for name, rows in made.items():
        lines += [name, "  " + "  ".join(f"{key:>15}" for key in rows[0])]
        lines += ["  " + "  ".join(f"{value:15.6g}" for value in row.values()) for row in rows]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
