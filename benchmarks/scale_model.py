"""Where one coordinator ends, and what regions with a coordinator each would bring: a model.

    python -m benchmarks.scale_model [--rate 30] [--plot FILE.svg] [--json]

It measures what things cost on this machine (benchmarks/scale_costs.py), and calculates from that;
nothing here was run at the sizes that it speaks of. Hosts are taken to be machines of their own,
each as quick as one core of this one; regions are squares of one plane, whose coordinators tell
each other in every frame what concerns both sides of a border.

One coordinator, N agents on H hosts, in seconds:

    frame = costs.frame + H costs.member                       the exchange
            + N (kind.coordinator + kind.bytes costs.byte)     what the coordinator does for agents
            + N / H kind.host                                  hosts, at the same time

The coordinator's part is the same however many hosts there are: that is where one coordinator
ends. η distributes over concatenation (equation 3), so w can be cut into R strings. Since what λ
emits belongs to the next frame, a region needs of its neighbours' frame t only what crosses their
border, and only before its own frame t + 1.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

HOSTS = tuple(sorted({round(2 ** (step / 2)) for step in range(24)}))
REGIONS = (1, 4, 16, 64)
FRAMES = 400
MOST = 1 << 40


@dataclass(frozen=True, slots=True)
class Kind:
    """What one agent costs in a frame: seconds of the coordinator and of its host, and bytes."""

    coordinator: float
    host: float
    bytes: float


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds that an empty frame takes, that each member and each byte adds to it.

    `spread` is how many times the median a frame takes at the 99th percentile.
    """

    frame: float
    member: float
    byte: float
    spread: float = 1.0
    kinds: Mapping[str, Kind] = field(default_factory=dict[str, Kind])


@dataclass(frozen=True, slots=True)
class Border:
    """What of the agents is near a border: those to which it is no farther than `reach`.

    The unit is the distance between agents, a million of which live on 1000 × 1000. Each of them
    costs as much again, at the neighbour that hears of it.
    """

    reach: float = 10.0

    def share(self, agents: float, regions: int) -> float:
        """The part of a region's agents that its neighbours hear of, too."""
        if regions == 1:
            return 0.0
        side = math.sqrt(agents / regions)
        return min(1.0, 4 * self.reach / max(side, 1e-9))


def coordinator_seconds(costs: Costs, kind: Kind, agents: float) -> float:
    """What a coordinator does for its agents in a frame."""
    return agents * (kind.coordinator + kind.bytes * costs.byte)


def frame_seconds(costs: Costs, kind: Kind, agents: float, hosts: int) -> float:
    """How long a frame takes with one coordinator."""
    exchange = costs.frame + hosts * costs.member
    return exchange + coordinator_seconds(costs, kind, agents) + agents / hosts * kind.host


def best_hosts(costs: Costs, kind: Kind, agents: float) -> int:
    """With how many hosts a frame is shortest."""
    return min(HOSTS, key=lambda hosts: frame_seconds(costs, kind, agents, hosts))


def region_seconds(
    costs: Costs, kind: Kind, agents: float, regions: int, border: Border = Border()
) -> float:
    """How long one of some regions needs for its part of a frame, waiting for nobody."""
    own_agents = agents / regions
    work = own_agents * (1 + border.share(agents, regions))
    hosts = best_hosts(costs, kind, work)
    neighbours = 0 if regions == 1 else 4
    return frame_seconds(costs, kind, work, hosts) + 2 * neighbours * costs.member


def in_step(seconds: float, regions: int, spread: float, frames: int = FRAMES) -> float:
    """Seconds a frame when each region waits for its neighbours before it begins the next one.

    How long a region needs is drawn from a log-normal distribution with this median, and `spread`
    times as much at the 99th percentile; the draws are always the same.
    """
    side = math.isqrt(regions)
    sigma = math.log(max(spread, 1.0)) / 2.326
    chance = np.random.default_rng(7)
    ends = np.zeros((side, side))
    for _ in range(frames):
        begins = ends.copy()
        for axis in (0, 1):
            for shift in (-1, 1):
                begins = np.maximum(begins, _beside(ends, shift, axis))
        ends = begins + seconds * np.exp(sigma * chance.standard_normal((side, side)))
    return float(ends.max()) / frames


def _beside(ends: np.ndarray, shift: int, axis: int) -> np.ndarray:
    """When the neighbour on one side ended; where there is none, at once."""
    moved = np.roll(ends, shift, axis)
    edge = [slice(None), slice(None)]
    edge[axis] = slice(0, 1) if shift > 0 else slice(-1, None)
    moved[tuple(edge)] = 0.0
    return moved


def most(holds: Callable[[int], bool]) -> int:
    """The greatest whole number for which something holds that ends holding once; 0: for none."""
    if not holds(1):
        return 0
    least, limit = 1, 2
    while limit < MOST and holds(limit):
        least, limit = limit, limit * 2
    while limit - least > max(1, least // 1000):
        middle = (least + limit) // 2
        least, limit = (middle, limit) if holds(middle) else (least, middle)
    return least


@dataclass(frozen=True, slots=True)
class Limit:
    """Where it ends at a rate: agents of a kind, the hosts that they need, what is exchanged."""

    kind: str
    regions: int
    agents: int
    hosts: int
    bytes: float


def limits(costs: Costs, rate: float) -> list[Limit]:
    """How many agents of each kind there can be, by the number of regions."""
    limits_: list[Limit] = []
    for name, kind in costs.kinds.items():
        for regions in REGIONS:
            drag = in_step(1.0, regions, costs.spread)

            def holds(
                agents: int, kind: Kind = kind, regions: int = regions, drag: float = drag
            ) -> bool:
                return region_seconds(costs, kind, agents, regions) * drag <= 1 / rate

            agents = most(holds)
            own_agents = agents / regions
            hosts = regions * best_hosts(costs, kind, own_agents) if agents else 0
            limits_.append(Limit(name, regions, agents, hosts, agents * kind.bytes))
    return limits_


def most_members(costs: Costs, rate: float) -> int:
    """How many members that have nothing to say one coordinator can ask at a rate."""
    return most(lambda count: costs.frame + count * costs.member <= 1 / rate)


def most_bytes(costs: Costs, rate: float) -> int:
    """How many bytes a frame can carry at a rate, made and read by nobody."""
    return most(lambda count: costs.frame + count * costs.byte <= 1 / rate)


def report(costs: Costs, rate: float) -> list[str]:
    """The table, as lines."""
    lines = [
        f"measured here: an empty frame {1e6 * costs.frame:.0f} µs, each member"
        f" {1e6 * costs.member:.0f} µs, {1e-6 / costs.byte:.0f} MB/s, p99 {costs.spread:.1f} × p50",
        f"one coordinator at {rate:g} frames/s: {most_members(costs, rate):,} members that say"
        f" nothing, or {most_bytes(costs, rate) / 1e6:.1f} MB a frame",
        "",
        f"{'agents':22} {'coordinator':>12} {'host':>10} {'bytes':>7}   each, µs and bytes a frame",
    ]
    for name, kind in costs.kinds.items():
        lines.append(
            f"{name:22} {1e6 * kind.coordinator:12.4f} {1e6 * kind.host:10.4f} {kind.bytes:7.1f}"
        )
    titles = f"{'agents':22} {'regions':>8} {'most at once':>14} {'hosts':>7} {'MB a frame':>11}"
    lines += ["", f"{titles}   at {rate:g} frames/s"]
    for limit in limits(costs, rate):
        lines.append(
            f"{limit.kind:22} {limit.regions:8} {limit.agents:14,} {limit.hosts:7,}"
            f" {limit.bytes / 1e6:11.2f}"
        )
    return lines


def draw(costs: Costs, file: Path) -> None:
    """Frames per second by agents, a line for each number of regions."""
    from benchmarks.plot import Line, plotted

    sizes = [round(10 ** (step / 4)) for step in range(12, 33)]
    lines = []
    for name, kind in costs.kinds.items():
        for regions in REGIONS:
            drag = in_step(1.0, regions, costs.spread)
            rates = [1 / (drag * region_seconds(costs, kind, size, regions)) for size in sizes]
            label = "1 coordinator" if regions == 1 else f"{regions} regions"
            lines.append(Line(name, label, sizes, rates))
    plotted(file, lines, "agents", "frames per second (model)")


def main() -> None:
    """Measure, calculate, print."""
    from benchmarks.command import PLOT, Option, options
    from benchmarks.scale_costs import measure

    arguments = options(__doc__, rate=Option(30.0, "frames per second"), plot=PLOT)
    costs = measure()
    if arguments.json:
        rows = [asdict(limit) for limit in limits(costs, arguments.rate)]
        print(json.dumps({"costs": asdict(costs), "limits": rows}))
    else:
        print("\n".join(report(costs, arguments.rate)))
    if arguments.plot:
        draw(costs, arguments.plot)


if __name__ == "__main__":
    main()
