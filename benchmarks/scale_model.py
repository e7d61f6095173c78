"""Model of the limits of one coordinator, and of regions with a coordinator each.

    python -m benchmarks.scale_model [--rate 30] [--plot FILE.svg] [--json]

The model measures costs on this machine (benchmarks/scale_costs.py) and extrapolates from them; no
world runs at the sizes in its table. It assumes that each host is a separate machine as fast as one
core of this one, and that regions are squares of one plane, whose coordinators exchange in every
frame whatever affects both sides of a border.

One coordinator, N agents on H hosts, in seconds:

    frame = costs.frame + H costs.member                       the exchange
            + N (kind.coordinator + kind.bytes costs.byte)     the coordinator's work for agents
            + N / H kind.host                                  hosts, in parallel

The coordinator's part does not depend on the number of hosts, so it limits one coordinator. η
distributes over concatenation (equation 3), so w can be split into R strings. Events emitted by λ
are processed in the next frame, so a region needs only the events that cross its border from frame
t of its neighbours, and only before its own frame t + 1.
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
    """Costs of one agent per frame: seconds of the coordinator and of its host, and bytes."""

    coordinator: float
    host: float
    bytes: float


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds for an empty frame, for each additional member and for each byte.

    `spread` is the ratio of the 99th percentile of the frame time to its median.
    """

    frame: float
    member: float
    byte: float
    spread: float = 1.0
    kinds: Mapping[str, Kind] = field(default_factory=dict[str, Kind])


@dataclass(frozen=True, slots=True)
class Border:
    """Agents near a border: those within a distance of `reach`.

    The unit is the distance between agents: a million of them cover 1000 × 1000. Each of them
    causes the same cost again in the neighbouring region.
    """

    reach: float = 10.0

    def share(self, agents: float, regions: int) -> float:
        """Fraction of a region's agents that its neighbours process too."""
        if regions == 1:
            return 0.0
        side = math.sqrt(agents / regions)
        return min(1.0, 4 * self.reach / max(side, 1e-9))


def coordinator_seconds(costs: Costs, kind: Kind, agents: float) -> float:
    """Seconds per frame of a coordinator's work for its agents."""
    return agents * (kind.coordinator + kind.bytes * costs.byte)


def frame_seconds(costs: Costs, kind: Kind, agents: float, hosts: int) -> float:
    """Seconds per frame with one coordinator."""
    exchange = costs.frame + hosts * costs.member
    return exchange + coordinator_seconds(costs, kind, agents) + agents / hosts * kind.host


def best_hosts(costs: Costs, kind: Kind, agents: float) -> int:
    """Number of hosts with the shortest frame."""
    return min(HOSTS, key=lambda hosts: frame_seconds(costs, kind, agents, hosts))


def region_seconds(
    costs: Costs, kind: Kind, agents: float, regions: int, border: Border = Border()
) -> float:
    """Seconds per frame of one of several regions, without waiting for others."""
    own_agents = agents / regions
    work = own_agents * (1 + border.share(agents, regions))
    hosts = best_hosts(costs, kind, work)
    neighbours = 0 if regions == 1 else 4
    return frame_seconds(costs, kind, work, hosts) + 2 * neighbours * costs.member


def in_step(seconds: float, regions: int, spread: float, frames: int = FRAMES) -> float:
    """Seconds per frame when each region waits for its neighbours before its next frame.

    The time of a region follows a log-normal distribution with median `seconds` and `spread` times
    as much at the 99th percentile; the random draws are always the same.
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
    """End times of the neighbours on one side; 0 without a neighbour."""
    moved = np.roll(ends, shift, axis)
    edge = [slice(None), slice(None)]
    edge[axis] = slice(0, 1) if shift > 0 else slice(-1, None)
    moved[tuple(edge)] = 0.0
    return moved


def most(holds: Callable[[int], bool]) -> int:
    """The largest integer for which a monotonic condition holds, or 0."""
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
    """Limits at a rate: agents of a kind, the required hosts, and the exchanged bytes."""

    kind: str
    regions: int
    agents: int
    hosts: int
    bytes: float


def limits(costs: Costs, rate: float) -> list[Limit]:
    """Maximum number of agents of each kind, by the number of regions."""
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
    """Maximum number of members without events for one coordinator at a rate."""
    return most(lambda count: costs.frame + count * costs.member <= 1 / rate)


def most_bytes(costs: Costs, rate: float) -> int:
    """Maximum number of bytes per frame at a rate, excluding encoding and decoding."""
    return most(lambda count: costs.frame + count * costs.byte <= 1 / rate)


def report(costs: Costs, rate: float) -> list[str]:
    """The table as lines of text."""
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
    """Plot frames per second over agents, with a line for each number of regions."""
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
    """Measure, calculate and print."""
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
