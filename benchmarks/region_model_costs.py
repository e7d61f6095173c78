"""Measured costs of this machine for benchmarks/region_model.py, from small worlds in one process.

The costs are those that fit the measured times best, relative to them, and are not negative.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.plot import Line, plotted
from benchmarks.region_halo import measured, world
from benchmarks.region_model import (
    PREDICTED,
    RegionCosts,
    coordinator_seconds,
    figures,
    frame_seconds,
    neighbours,
    region_seconds,
)
from benchmarks.scale_costs import lockstep_costs, seconds_per_byte

FITTED: Final = ((1, 250), (1, 1000), (1, 2000), (4, 500), (8, 250), (9, 100), (9, 1000), (12, 500))
COMPARED: Final = ((2, 1000), (4, 1000), (16, 1000), (16, 250), (64, 250))
SIZES: Final = (100, 1000, 10_000)


@dataclass(frozen=True, slots=True)
class Times:
    """CPU seconds of a frame in a world: of its coordinator, and of each region on average."""

    regions: int
    agents: int
    coordinator: float
    region: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """Predicted and measured CPU milliseconds of a frame, of all regions and the coordinator."""

    regions: int
    agents: int
    predicted_ms: float
    measured_ms: float

    def __str__(self) -> str:
        error = 100 * (self.predicted_ms / self.measured_ms - 1)
        return (
            f"{self.regions:4} regions, {self.agents:5} agents in each: measured"
            f" {self.measured_ms:7.1f} ms, predicted {self.predicted_ms:7.1f} ms ({error:+.0f} %)"
        )


def times_of(
    worlds: Iterable[tuple[int, int]], frames: int, turns: int, halo: str = "true"
) -> list[Times]:
    """The times of these worlds, given by regions and agents in each; the turns alternate."""
    worlds = [*worlds]
    best: dict[tuple[int, int], Times] = {}
    for _ in range(turns):
        for regions, agents in worlds:
            with tempfile.TemporaryDirectory() as folder:
                path = world(Path(folder), regions * agents, regions, halo)
                row = measured(path, regions * agents, regions, frames)
            whole, all_ = row["coordinator µs"], row["all µs"]
            made = Times(
                regions, agents, 1e-6 * whole * agents * regions, 1e-6 * (all_ - whole) * agents
            )
            last = best.get((regions, agents), made)
            best[regions, agents] = Times(
                regions, agents, min(made.coordinator, last.coordinator),
                min(made.region, last.region),
            )  # fmt: skip
    return [best[key] for key in worlds]


def fitted(times: Sequence[Times]) -> RegionCosts:
    """The costs that fit measured times, without those of Zenoh."""
    of_coordinator = _solved(
        [[1.0, each.regions, each.regions * each.agents] for each in times],
        [each.coordinator for each in times],
    )
    of_region = _solved(
        [
            [1.0, each.agents, neighbours(each.regions), figures(each.agents, each.regions)]
            for each in times
        ],
        [each.region for each in times],
    )
    return RegionCosts(*of_coordinator, *of_region)


def _solved(rows: Sequence[Sequence[float]], seconds: Sequence[float]) -> list[float]:
    """The factors, at least 0, by which relative errors have the least squares."""
    wanted = np.array(seconds)
    table: NDArray[Any] = np.array(rows) / wanted[:, None]
    used = [*range(table.shape[1])]
    # Without the most negative one until none is.
    while True:
        solution = np.linalg.lstsq(table[:, used], np.ones(len(wanted)), rcond=None)[0]
        if solution.min() >= 0.0:
            break
        del used[int(solution.argmin())]
    factors = np.zeros(table.shape[1])
    factors[used] = solution
    return factors.tolist()


def measure(frames: int, turns: int) -> RegionCosts:
    """Measure all costs of this machine; takes some minutes."""
    costs = fitted(times_of(FITTED, frames, turns))
    exchange = lockstep_costs()
    return RegionCosts(
        costs.whole, costs.report, costs.whole_agent, costs.frame, costs.agent, costs.neighbour,
        costs.figure, exchange.member, seconds_per_byte(), exchange.spread,
    )  # fmt: skip


def compared(costs: RegionCosts, frames: int, turns: int) -> list[Comparison]:
    """Predictions for worlds that no cost is made of, and what these take in one process."""
    alone = RegionCosts(
        costs.whole, costs.report, costs.whole_agent, costs.frame, costs.agent, costs.neighbour,
        costs.figure,
    )  # fmt: skip
    made: list[Comparison] = []
    for each in times_of(COMPARED, frames, turns):
        count, agents = each.regions, each.agents
        predicted = coordinator_seconds(alone, agents, count)
        predicted += count * region_seconds(alone, agents, count)
        took = each.coordinator + count * each.region
        made.append(Comparison(count, agents, 1e3 * predicted, 1e3 * took))
    return made


def drawn(costs: RegionCosts, file: Path) -> None:
    """Plot frames per second over regions, with a line for each number of agents in a region."""
    lines = [
        Line(
            "Regions with a core each",
            f"{agents:,} agents in each",
            [*PREDICTED],
            [1 / frame_seconds(costs, agents, regions) for regions in PREDICTED],
        )
        for agents in SIZES
    ]
    plotted(file, lines, "regions", "frames per second (model)")
