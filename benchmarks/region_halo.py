"""CPU time and bytes of regions that look for neighbours with a halo, in a world that grows or not.

    python -m benchmarks.region_halo [--agents 1000] [--regions 1 2 4 8 16] [--halo true] [--json]
    python -m benchmarks.region_halo --total 8000 --regions 1 2 4 --halo false true

Agents on a torus with one agent per square metre see their neighbours within 3 m (28 on average)
and give way. With `--agents` each region has so many, so the world grows with the number of
regions; with `--total` the world stays as it is and is divided. Coordinator and regions run in this
process and exchange messages as bytes, as with processes (benchmarks.region_costs), so Zenoh's time
is not included. CPU times are per agent and frame: of the coordinator, of region 0 and of the other
regions, each for the agents of that region. `border` is a directed pair of regions that exchange
parcels; its bytes and messages are those of one frame.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.command import Option, Table, options
from minerva_bus import (
    Agent,
    BatchContext,
    Event,
    EventType,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    view,
)
from minerva_bus.launch.compiling import compile_agents, no_progress
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.regions.layout import in_regions
from minerva_bus.settings.overrides import Overrides
from minerva_bus.testing.simulation.cluster import Cluster

if TYPE_CHECKING:
    from minerva_bus.launch.regions.member import RegionMember

COLUMNS: Final = {
    "regions": ">8", "halo": ">6", "agents": ">8,", "coordinator µs": ">15.1f",
    "region 0 µs": ">12.1f", "other regions µs": ">17.1f", "all µs": ">8.1f",
    "borders": ">8", "bytes a border": ">15,.0f", "messages a border": ">18.2f",
}  # fmt: skip
WARM_UP: Final = 3

PSpot = Primitive("PSpot", who=str, vx=float, vy=float)
TAt = Transformation("TAt", x=Metres, y=Metres)
eSpots = EventType("eSpots", visual=True)
eNear = EventType("eNear", vx=float, vy=float, apart_x=Metres, apart_y=Metres)


class Drifter(Agent, symbol="ADrifter"):
    """Gives way to its neighbours on a torus of a width and a height."""

    x: Metres = 0.0
    y: Metres = 0.0
    vx: float = 0.0
    vy: float = 0.0
    width: Metres = 1.0
    height: Metres = 1.0

    @on("eNear", population=True)
    def drift(self, near: Event, moment: BatchContext) -> None:
        """Move away from near neighbours, and as the others do."""
        self.vx = 0.9 * self.vx + 0.1 * near.vx + 0.01 * near.apart_x
        self.vy = 0.9 * self.vy + 0.1 * near.vy + 0.01 * near.apart_y
        self.x = (self.x + 0.1 * self.vx) % self.width
        self.y = (self.y + 0.1 * self.vy) % self.height

    @view("eSpots", population=True)
    def spot(self, event: Event) -> Scene:
        """Position, id and velocity."""
        return TAt(self.x, self.y)(PSpot(self.id, self.vx, self.vy))


vocabulary = Vocabulary.of(PSpot, TAt, eSpots, eNear, Drifter)


def scene(given: Mapping[str, Any]) -> Scene:
    """Agents at random positions, with random velocities."""
    chance, count = np.random.default_rng(1), given["agents"]
    size = given["width"], given["height"]
    x, y = (chance.uniform(0.0, length, count) for length in size)
    vx, vy = chance.uniform(-1.0, 1.0, (2, count))
    width, height = (np.full(count, length) for length in size)
    return Drifter.many("d", count, x=x, y=y, vx=vx, vy=vy, width=width, height=height)


def world(folder: Path, agents: int, regions: int, halo: str) -> Path:
    """A world file with a torus that is divided into cells of equal size, as square as possible."""
    columns = max(n for n in range(1, regions + 1) if regions % n == 0 and n * n <= 2 * regions)
    rows = regions // columns
    side = (agents / regions) ** 0.5
    width, height = side * columns, side * rows
    borders = {"x": [side * n for n in range(1, columns)], "y": [side * n for n in range(1, rows)]}
    grid = ", ".join(f"{name} = {at}" for name, at in borders.items())
    path = folder / "drift.toml"
    path.write_text(
        '[world]\nvocabulary = "benchmarks.region_halo:vocabulary"\nseed = 7\n'
        'scene = "benchmarks.region_halo:scene"\n'
        f"[options]\nagents = {agents}\nwidth = {width!r}\nheight = {height!r}\n"
        '[process.drifters]\nagents = "benchmarks.region_halo:Drifter"\n'
        '[process.neighbours]\nservice = "neighbours"\ndraws = "eSpots"\n'
        "radius = 3.0\napart = 1.0\n"
        f"width = {width!r}\nheight = {height!r}\nperiodic = true\nsummary = true\n"
        f"[regions]\ngrid = {{ {grid} }}\nhalo = {halo}\n"
    )
    return path


class Meter:
    """CPU seconds by part of a cluster, and the messages between regions, after a warm-up."""

    def __init__(self, cluster: Cluster) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.sent: dict[tuple[int, int], list[int]] = defaultdict(list)
        self._cluster = cluster
        self._warm = False
        cluster.runner.handle = self._timed("coordinator", cluster.runner.handle)
        cluster.links.forge = self._count
        for name, member in cluster.members.items():
            self._watch(name, member)

    def _watch(self, name: str, member: RegionMember) -> None:
        member.receive = self._timed(name, member.receive)
        member.parcel = self._timed(name, member.parcel)

    def _timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*given: Any) -> Any:
            begin = time.process_time()
            try:
                return call(*given)
            finally:
                self.seconds[name] += time.process_time() - begin

        return timed

    def _count(self, source: int, target: int, data: bytes) -> bytes:
        self.sent[source, target].append(len(data))
        return data

    def begin(self, _: Cluster) -> None:
        """Forget what the first frames have taken, once."""
        if not self._warm and len(self._cluster.done) >= WARM_UP:
            self._warm = True
            self.seconds.clear()
            self.sent.clear()


def measured(path: Path, agents: int, regions: int, frames: int) -> dict[str, float]:
    """The figures of one run of a world file with so many agents."""
    file = read_world_file(path, Overrides(frames=frames + WARM_UP))
    compile_agents(file.processes, no_progress)
    with in_regions(file) as processes:
        cluster = Cluster(processes, Random(1))
        meter = Meter(cluster)
        cluster.run(meter.begin)
    used = {name: 1e6 * seconds / frames for name, seconds in meter.seconds.items()}
    coordinator = used.pop("coordinator") / agents
    each = [used[name] * regions / agents for name in sorted(used)]
    borders = meter.sent
    return {
        "coordinator µs": coordinator,
        "region 0 µs": each[0],
        "other regions µs": statistics.mean(each[1:]) if each[1:] else 0.0,
        "all µs": coordinator + statistics.mean(each),
        "borders": len(borders),
        "bytes a border": sum(map(sum, borders.values())) / frames / max(1, len(borders)),
        "messages a border": sum(map(len, borders.values())) / frames / max(1, len(borders)),
    }


def main() -> None:
    """Print a row for each number of regions, with and without a halo."""
    given = options(
        __doc__, agents=Option(1000, "in each region"), total=Option(0, "in all regions together"),
        regions=[1, 2, 4, 8, 16], halo=Option(["true"], "true, false or both"), frames=10, turns=3,
    )  # fmt: skip
    table = Table(COLUMNS, as_json=given.json)
    for count in given.regions:
        agents = given.total or count * given.agents
        for halo in given.halo if count > 1 else given.halo[:1]:
            with tempfile.TemporaryDirectory() as folder:
                path = world(Path(folder), agents, count, halo)
                run = partial(measured, path, agents, count, given.frames)
                turns = [run() for _ in range(given.turns)]
            best = {name: min(turn[name] for turn in turns) for name in turns[0]}
            table.row({"regions": count, "halo": halo, "agents": agents, **best})


if __name__ == "__main__":
    main()
