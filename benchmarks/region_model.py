"""Model of a world in regions: CPU time of its coordinator and of each region, and what limits it.

    python -m benchmarks.region_model [--agents 1000] [--rate 30] [--plot FILE.svg] [--json]

The world is that of benchmarks.region_halo: agents on a torus, one per square metre, who see their
neighbours within 3 m. The costs are measured on this machine with a few small worlds
(benchmarks/region_model_costs.py), then compared to worlds of 2, 4, 16 and 64 regions, of which
they are not made, and extrapolated. R regions have n agents each, and k neighbours with h of their
figures around each cell. In seconds of CPU time:

    region      = frame + n agent + k (neighbour + member) + h figure
    coordinator = whole + R (report + member) + R n whole_agent + R requests byte

`requests` are the bytes of the pairs of regions with parcels, which each region receives. `member`
and `byte` are what Zenoh costs (benchmarks/scale_costs.py); worlds in one process have neither. A
frame takes the time of the slowest region, with a core of its own, and then that of the
coordinator. With a tree of reports, so many relays stand between the coordinator and the regions
that it is fastest; each merges the reports of its regions into one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import NormalDist
from typing import Final

from benchmarks.scale_model import most

PREDICTED: Final = 1, 4, 16, 64, 256, 1024, 4096
RADIUS: Final = 3.0
PAIR_BYTES: Final = 4
AT_99_PERCENT: Final = NormalDist().inv_cdf(0.99)


@dataclass(frozen=True, slots=True)
class RegionCosts:
    """Seconds of CPU time in each frame; `spread` is the 99th percentile of a time to its median.

    Of the coordinator: `whole` for a frame, for each `report` and for each `whole_agent`. Of a
    region: for a `frame`, for each `agent`, `neighbour` and `figure` of neighbours. Of Zenoh, for
    each `member` and `byte`.
    """

    whole: float
    report: float
    whole_agent: float
    frame: float
    agent: float
    neighbour: float
    figure: float
    member: float = 0.0
    byte: float = 0.0
    spread: float = 1.0


def neighbours(regions: int) -> int:
    """The neighbours of a region on a torus that is divided as in benchmarks.region_halo."""
    return {1: 0, 2: 1, 4: 3, 8: 5}.get(regions, 8)


def figures(agents: float, regions: int) -> float:
    """The figures of neighbours around the cell of a region, one per square metre."""
    if regions == 1:
        return 0.0
    return 4 * RADIUS * math.sqrt(agents) + 4 * RADIUS**2


def region_seconds(costs: RegionCosts, agents: float, regions: int) -> float:
    """CPU time of a region with so many agents."""
    shared = neighbours(regions) * (costs.neighbour + costs.member)
    return costs.frame + agents * costs.agent + shared + figures(agents, regions) * costs.figure


def coordinator_seconds(
    costs: RegionCosts, agents: float, regions: int, reports: int | None = None
) -> float:
    """CPU time of the coordinator of regions with so many agents each.

    It has so many `reports`, of all regions or of relays.
    """
    reports = regions if reports is None else reports
    requests = PAIR_BYTES * neighbours(regions) * regions
    each = costs.report + costs.member + requests * costs.byte
    return costs.whole + reports * each + regions * agents * costs.whole_agent


def slowest(spread: float, regions: int) -> float:
    """How much longer than the median the slowest of several regions takes, if all are equal.

    Their times follow a log-normal distribution.
    """
    sigma = math.log(max(spread, 1.0)) / AT_99_PERCENT
    return math.exp(sigma * max(0.0, NormalDist().inv_cdf(regions / (regions + 1))))


def frame_seconds(
    costs: RegionCosts, agents: float, regions: int, reports: int | None = None
) -> float:
    """Time of a frame if the coordinator, and each region, has a core of its own."""
    late = slowest(costs.spread, regions) * region_seconds(costs, agents, regions)
    return late + coordinator_seconds(costs, agents, regions, reports)


def relays(regions: int) -> int:
    """The relays of a tree of reports: each has as many regions as the coordinator has relays."""
    return math.isqrt(regions)


@dataclass(frozen=True, slots=True)
class Prediction:
    """Milliseconds of CPU time, and frames per second; what takes most of the coordinator's time.

    `tree_rate`: frames per second with a tree of reports; `agents_at_rate`: the largest number of
    agents, in all regions together, at a rate.
    """

    regions: int
    region_ms: float
    coordinator_ms: float
    rate: float
    first: str
    tree_rate: float
    agents_at_rate: int


def predicted(costs: RegionCosts, agents: int, regions: int, rate: float) -> Prediction:
    """The prediction for regions with so many agents each."""
    coordinator = coordinator_seconds(costs, agents, regions)
    requests = PAIR_BYTES * neighbours(regions) * regions**2
    shares = {
        "agents": regions * agents * costs.whole_agent,
        "reports": regions * (costs.report + costs.member),
        "requests": requests * costs.byte,
        "frame": costs.whole,
    }
    # A relay passes on the reports of its regions, which takes it as long as it takes the root.
    tree = frame_seconds(costs, agents, regions, relays(regions))
    tree += relays(regions) * (costs.report + costs.member) if regions > 1 else 0.0

    def holds(each: int) -> bool:
        return frame_seconds(costs, each, regions) <= 1 / rate

    return Prediction(
        regions,
        1e3 * region_seconds(costs, agents, regions),
        1e3 * coordinator,
        1 / frame_seconds(costs, agents, regions),
        max(shares, key=lambda name: shares[name]),
        1 / tree,
        regions * most(holds),
    )


def report(costs: RegionCosts, rows: Sequence[Prediction], agents: int, rate: float) -> list[str]:
    """The costs, and a line for each number of regions."""
    units = {name: 1e6 * value for name, value in asdict(costs).items()}
    measured = ("whole", "report", "whole_agent", "frame", "agent", "neighbour", "figure", "member")
    return [
        "µs: " + ", ".join(f"{name} {units[name]:.2f}" for name in measured),
        f"bytes between sessions: {1e-6 / costs.byte:.0f} MB/s; p99 {costs.spread:.2f} × p50",
        "",
        f"{'regions':>8} {'region ms':>10} {'coordinator ms':>15} {'most of it':>11}"
        f" {'frames/s':>9} {'with a tree':>12} {'agents at':>11}   {agents} agents in each",
        *(
            f"{row.regions:8,} {row.region_ms:10.2f} {row.coordinator_ms:15.2f} {row.first:>11}"
            f" {row.rate:9.1f} {row.tree_rate:12.1f} {row.agents_at_rate:11,}   {rate:g} frames/s"
            for row in rows
        ),
    ]


def main() -> None:
    """Measure, compare with measured worlds, and predict."""
    from benchmarks.command import PLOT, Option, options
    from benchmarks.region_model_costs import compared, drawn, measure

    given = options(
        __doc__, agents=Option(1000, "in each region"), rate=Option(30.0, "frames per second"),
        frames=Option(8, "of each measured world"), turns=Option(3, "of which the fastest counts"),
        plot=PLOT,
    )  # fmt: skip
    costs = measure(given.frames, given.turns)
    errors = compared(costs, given.frames, given.turns)
    rows = [predicted(costs, given.agents, regions, given.rate) for regions in PREDICTED]
    if given.json:
        print(json.dumps({
            "costs": asdict(costs),
            "compared": [asdict(each) for each in errors],
            "predicted": [asdict(row) for row in rows],
        }))  # fmt: skip
    else:
        print("\n".join([*map(str, errors), "", *report(costs, rows, given.agents, given.rate)]))
    if given.plot:
        drawn(costs, given.plot)


if __name__ == "__main__":
    main()
