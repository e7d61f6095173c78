"""SUMO's tutorials: vehicles on its networks, beside what SUMO computes.

SUMO makes the networks and the routes. It also decides when, where and how fast each vehicle
departs, and how much of the speed limit it likes to drive. From then on the vehicles of the world
drive by themselves. Without dawdling, their places and speeds have to be SUMO's in every second;
with it, the distributions are compared. SUMO's rules for junctions are many; the world
has two: to be slow enough, and to let those pass who have the right of way. So distances on the
grid may differ by a tenth.
"""

# sumolib has no types of its own.
# pyright: basic

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from tools.acceptance.library import compared
from tools.acceptance.suite import MissingSuiteError, Outcome, Result, Suite

SECONDS, CLOSES = 1100, 1000
"""Duration of a run, and the end of the new goals in the tutorial of circles."""

SEEDS, DAWDLED, ERROR = 20, 300, 0.01
EXACT, NEAR = 1e-6, 0.1
"""Differences in metres or metres per second, and of means as a part."""

MINOR = 10.2
"""Speed at which a vehicle enters a junction if it has to look for others there, m/s."""

RULES = "SUMO's rules for junctions are finer: its vehicles see each other there, wait and merge"
TRIPS = '--trip-attributes=departPos="random" departSpeed="max"'


class Trips(NamedTuple):
    """What SUMO computed: for each vehicle its trip, and its lane, place and speed by second."""

    trips: Mapping[str, Any]
    places: Mapping[str, Mapping[int, tuple[str, float, float]]]

    def column(self, name: str) -> Any:
        """A number of each trip."""
        return np.array([float(getattr(trip, name)) for trip in self.trips.values()])


def _run(program: str, folder: Path, *words: str) -> None:
    import sumo

    command = [str(Path(sumo.SUMO_HOME, "bin", program)), *words]
    if program.endswith(".py"):
        command = [sys.executable, str(Path(sumo.SUMO_HOME, "tools", program)), *words]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)


def _simulated(folder: Path, network: str, *words: str) -> Trips:
    from sumolib import xml

    _run("sumo", folder, "-n", network, *words, "--no-step-log", "--precision", "12",
         "--end", str(SECONDS), "--tripinfo-output", "trips.xml",
         "--tripinfo-output.write-unfinished", "--fcd-output", "places.xml")  # fmt: skip
    trips = {_id(trip): trip for trip in xml.parse(str(folder / "trips.xml"), "tripinfo")}
    places: dict[str, dict[int, tuple[str, float, float]]] = {who: {} for who in trips}
    for step in xml.parse(str(folder / "places.xml"), "timestep"):
        for vehicle in step.vehicle or ():
            place = vehicle.lane, float(vehicle.pos), float(vehicle.speed)
            places[_id(vehicle)][int(float(step.time))] = place
    return Trips(trips, places)


def _id(element: Any) -> str:
    return element.id.replace(".", "_")


def _way(net: Any, edges: Sequence[str], renewed: Sequence[str] = ()) -> Any:
    """The way along these edges; where it enters those of `renewed`, its goal is the next one."""
    from tools.acceptance.vehicles import Way

    lanes: list[tuple[str, float, float]] = []
    for edge, after in zip(edges, [*edges[1:], ""], strict=True):
        lane = net.getEdge(edge).getLane(0)
        lanes.append((lane.getID(), lane.getLength(), lane.getSpeed()))
        link = net.getEdge(edge).getConnections(net.getEdge(after))[0] if after else None
        limit = MINOR if link and link.getState() == "m" else np.inf
        while link and link.getViaLaneID():
            lane = net.getLane(link.getViaLaneID())
            lanes.append((lane.getID(), lane.getLength(), min(lane.getSpeed(), limit)))
            link = next(iter(lane.getOutgoing()), None)
    names, lengths, limits = zip(*lanes, strict=True)
    starts = np.cumsum([0.0, *lengths])
    news = [n for n, name in enumerate(names) if name.rpartition("_")[0] in renewed]
    goals = [(starts[new], starts[after + 1]) for new, after in pairwise(news)]
    return Way(names, starts[:-1], limits, goals)


def _yields(net: Any) -> Mapping[str, Sequence[str]]:
    """For each lane into a junction those to which its vehicles give way."""
    yields: dict[str, Sequence[str]] = {}
    for node in net.getNodes():
        links = [link for edge in node.getIncoming() for group in edge.getOutgoing().values()
                 for link in group]  # fmt: skip
        for link in links:
            others = [other for other in links if other is not link and node.forbids(other, link)]
            yields[link.getViaLaneID()] = [other.getViaLaneID() for other in others]
    return yields


def _world(theirs: Trips, ways: Mapping[str, Any], net: Any, closes: float, **kind: float) -> Any:
    from tools.acceptance import vehicles

    goals = [way.goals[0][1] if way.goals else way.starts[-1] + 1 for way in ways.values()]
    columns = {
        "x": theirs.column("departPos"),
        "speed": theirs.column("departSpeed"),
        "departs": theirs.column("depart"),
        "wish": theirs.column("speedFactor"),
        "goal": np.array(goals),
        "length": 5.0,
        **kind,
    }
    return vehicles.world({"ids": list(ways), **columns}, ways, _yields(net), closes)


def _driven(world: Any, seconds: int) -> Iterator[Any]:
    """The vehicles in every second."""
    from tools.acceptance import vehicles

    with world.start(seed=1) as live:
        for _ in range(seconds):
            yield live.agents(vehicles.Vehicle)
            live.step(vehicles.STEP)


def _exact(case: str, theirs: Trips, world: Any, ways: Mapping[str, Any]) -> Result:
    """Whether each vehicle is where SUMO has it in every second, and arrives when it does."""
    from tools.acceptance.vehicles import lane_at

    worst, count, last = 0.0, 0, None
    for second, last in enumerate(_driven(world, SECONDS)):
        for who, x, speed in zip(last["id"], last["x"], last["speed"], strict=True):
            place = theirs.places[who].get(second)
            if place is None:
                continue
            way = ways[who]
            lane = lane_at(way, x)
            if way.lanes[lane] != place[0]:
                reason = f"{who} is on {way.lanes[lane]} after {second} s; expected {place[0]}"
                return Result(case, Outcome.FAILED, reason)
            worst = max(worst, abs(x - way.starts[lane] - place[1]), abs(speed - place[2]))
            count += 1
    assert last is not None
    arrivals = dict(zip(last["id"], last["arrives"], strict=True))
    expected = {who: float(trip.arrival) for who, trip in theirs.trips.items()}
    wrong = [f"{who} arrives after {arrivals[who]:g} s; expected {time:g} s"
             for who, time in expected.items() if arrivals[who] != time]  # fmt: skip
    wrong += [f"a difference of {worst:.2g} m or m/s"] if worst > EXACT else []
    figures = {"Minerva Bus": f"{count:,} places", "SUMO": "equal" if not wrong else "differ"}
    outcome = Outcome.FAILED if wrong else Outcome.PASSED
    return Result(case, outcome, next(iter(wrong), ""), figures)


def _results(folder: Path) -> Iterator[Result]:
    if find_spec("sumo") is None or find_spec("sumolib") is None:
        raise MissingSuiteError("it needs SUMO: pip install eclipse-sumo sumolib")
    for play in (_hello, _circles, _manhattan):
        with TemporaryDirectory(prefix="minerva-acceptance-") as place:
            name = play.__name__.strip("_")
            if not (folder / name / "data").exists():
                raise MissingSuiteError(f"no {folder / name / 'data'}")
            copy = Path(shutil.copytree(folder / name / "data", Path(place, name)))
            yield from play(copy)


def _hello(folder: Path) -> Iterator[Result]:
    """One vehicle on a road."""
    from sumolib.net import readNet

    _run("netconvert", folder, "-c", "hello.netccfg")
    theirs = _simulated(folder, "hello.net.xml", "-r", "hello.rou.xml")
    net = readNet(str(folder / "hello.net.xml"), withInternal=True)
    ways = dict.fromkeys(theirs.trips, _way(net, ["1to2", "out"]))
    world = _world(theirs, ways, net, 0, acceleration=1.0, braking=5.0, dawdling=0.0, space=2.0,
                   fastest=50.0)  # fmt: skip
    yield _exact("hello", theirs, world, ways)


def _circles(folder: Path) -> Iterator[Result]:
    """Five vehicles on a ring, which get new goals until a time."""
    from sumolib.net import readNet

    net = readNet(str(folder / "circles.net.xml"), withInternal=True)
    edges = ["edge1"]
    while len(edges) < SECONDS:
        edges.append(next(iter(net.getEdge(edges[-1]).getOutgoing())).getID())
    way = _way(net, edges, ["edge1", "edge2"])
    routes = folder / "circles.rou.xml"
    text = routes.read_text(encoding="utf-8")
    words = ["-r", routes.name, "-a", "circles.add.xml", "--seed"]
    kind = {"acceleration": 3.5, "braking": 2.2}
    ours, others = [], []
    for seed in range(SEEDS):
        theirs = _simulated(folder, "circles.net.xml", *words, str(seed))
        world = _world(theirs, dict.fromkeys(theirs.trips, way), net, CLOSES, dawdling=1.0, **kind)
        *_, last = _driven(world, DAWDLED)
        ours.append(float(np.mean(last["x"] - theirs.column("departPos"))))
        others.append(_covered(theirs, way))
    case = f"circles: metres in {DAWDLED} s with dawdling"
    yield compared(case, ours, others, ERROR, "SUMO")
    routes.write_text(text.replace('sigma="1.0"', 'sigma="0"'), encoding="utf-8")
    theirs = _simulated(folder, "circles.net.xml", *words, "0")
    ways = dict.fromkeys(theirs.trips, way)
    world = _world(theirs, ways, net, CLOSES, dawdling=0.0, **kind)
    yield _exact("circles without dawdling", theirs, world, ways)


def _covered(theirs: Trips, way: Any) -> float:
    """The mean distance that SUMO's vehicles have covered on a ring."""
    numbers = {name: way.starts[n] for n, name in reversed([*enumerate(way.lanes)])}
    length = way.starts[way.lanes.index(way.lanes[0], 1)]
    covered = []
    for who, trip in theirs.trips.items():
        x, rounds = float(trip.departPos), 0
        for second in range(int(float(trip.depart)), DAWDLED):
            lane, place, _ = theirs.places[who][second]
            here = numbers[lane] + place
            rounds += here < x
            x = here
        covered.append(rounds * length + x - float(trip.departPos))
    return float(np.mean(covered))


def _manhattan(folder: Path) -> Iterator[Result]:
    """A hundred vehicles on a grid of streets."""
    from sumolib import xml
    from sumolib.net import readNet

    _run("netgenerate", folder, "-c", "manhattan.netgcfg")
    _run("randomTrips.py", folder, "--flows", "100", "-b", "0", "-e", "1", "-n", "net.net.xml",
         "-o", "flows.xml", "--jtrrouter", TRIPS)  # fmt: skip
    _run("jtrrouter", folder, "-c", "manhattan.jtrrcfg")
    theirs = _simulated(folder, "net.net.xml", "-r", "routes.xml")
    net = readNet(str(folder / "net.net.xml"), withInternal=True)
    edges = {_id(vehicle): vehicle.route[0].edges.split()
             for vehicle in xml.parse(str(folder / "routes.xml"), "vehicle")}  # fmt: skip
    ways = {who: _way(net, edges[who]) for who in theirs.trips}
    *_, last = _driven(_world(theirs, ways, net, 0), SECONDS)
    ours = float(np.mean(last["x"] - theirs.column("departPos")))
    other = float(np.mean(theirs.column("routeLength")))
    figures = {"Minerva Bus": f"{ours:,.0f}", "SUMO": f"{other:,.0f}"}
    near = abs(ours / other - 1) < NEAR
    outcome, reason = (Outcome.EXPECTED, RULES) if near else (Outcome.FAILED, "further apart")
    yield Result(f"manhattan: metres in {SECONDS:,} s", outcome, reason, figures)


SUMO = Suite(
    "sumo",
    "eclipse-sumo/sumo",
    "tests/complex/tutorial",
    "vehicles on networks of SUMO that follow each other: places, speeds and arrivals",
    _results,
)
