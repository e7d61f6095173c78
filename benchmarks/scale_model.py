"""Model of the limits of one coordinator; benchmarks/region_model.py is that of regions.

    python -m benchmarks.scale_model [--rate 30] [--json]

The model measures costs on this machine (benchmarks/scale_costs.py) and extrapolates from them; no
world runs at the sizes in its table. It assumes that each host is a separate machine as fast as one
core of this one. N agents on H hosts, in seconds:

    frame = costs.frame + H costs.member                       the exchange
            + N (kind.coordinator + kind.bytes costs.byte)     the coordinator's work for agents
            + N / H kind.host                                  hosts, in parallel

The coordinator's part does not depend on the number of hosts, so it limits one coordinator.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field

HOSTS = tuple(sorted({round(2 ** (step / 2)) for step in range(24)}))
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
    agents: int
    hosts: int
    bytes: float


def limits(costs: Costs, rate: float) -> list[Limit]:
    """Maximum number of agents of each kind."""
    limits_: list[Limit] = []
    for name, kind in costs.kinds.items():

        def holds(agents: int, kind: Kind = kind) -> bool:
            hosts = best_hosts(costs, kind, agents)
            return frame_seconds(costs, kind, agents, hosts) <= 1 / rate

        agents = most(holds)
        hosts = best_hosts(costs, kind, agents) if agents else 0
        limits_.append(Limit(name, agents, hosts, agents * kind.bytes))
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
    titles = f"{'agents':22} {'most at once':>14} {'hosts':>7} {'MB a frame':>11}"
    lines += ["", f"{titles}   at {rate:g} frames/s"]
    for limit in limits(costs, rate):
        lines.append(
            f"{limit.kind:22} {limit.agents:14,} {limit.hosts:7,} {limit.bytes / 1e6:11.2f}"
        )
    return lines


def main() -> None:
    """Measure, calculate and print."""
    from benchmarks.command import Option, options
    from benchmarks.scale_costs import measure

    arguments = options(__doc__, rate=Option(30.0, "frames per second"))
    costs = measure()
    if arguments.json:
        rows = [asdict(limit) for limit in limits(costs, arguments.rate)]
        print(json.dumps({"costs": asdict(costs), "limits": rows}))
    else:
        print("\n".join(report(costs, arguments.rate)))


if __name__ == "__main__":
    main()
