"""Distance that a robot drives to find a marker on an unknown floor.

    python -m benchmarks.exploration [--json] [--seeds 1,2] [--held-out 11,12] [--noise]
                                     [--strategy astar|nearest|random] [--only NAME] [--large]
                                     [--check] [--jobs 2]

Each floor is explored for two markers: the farthest one, which `minerva run robot --map` selects,
and another one. `ratio` is the driven distance divided by the length of the shortest path on the
true map, with moves to eight neighbours, for a disc of the robot's radius. A run ends when the
robot arrives or gives up with eUnreachable (`reported`); only its own patience limits the search.
`tour` is the same ratio for a robot that knows the map, but not the marker, and drives a tour with
a view of the complete floor. It is omitted for floors that are too large.

The strategy is tuned on the floors of --seeds and not on those of --held-out. Halls of different
seeds differ only in the start. `--check` also runs the floors in the complete world.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from benchmarks.exploring.driving import Drive, Floor, Noise
from benchmarks.exploring.floors import Named, generated, large, of_others
from benchmarks.exploring.strategies import use
from benchmarks.exploring.tours import tour_of
from minerva_agents.robot.distances import clearance
from minerva_agents.robot.maps import MapPose, Marker, OccupancyMap
from minerva_agents.robot.placing import roomiest, spread
from minerva_agents.robot.planning import shortest_path
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import scene
from minerva_bus.grammar.scene import agents

RADIUS, SPEED = 0.18, 0.8
MOST_FRAMES = 1_000_000
"""Beyond the patience of any robot: a run of this length is neither reached nor reported."""

LARGEST_TOUR_M = 40.0
"""Longest side in metres of floors for which the tour takes seconds rather than minutes."""

NOISE = Noise(laser=0.02, dropout=0.02, drive=0.02)


@dataclass(frozen=True, slots=True)
class Task:
    """Parameters of a run."""

    named: Named
    start: MapPose
    marker: Marker
    shortest: float | None
    noise: Noise
    strategy: str


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a run, in metres and seconds."""

    map: str
    marker: str
    held_out: bool
    noise: bool
    strategy: str
    reached: bool
    ratio: float | None
    tour: float | None
    metres: float
    shortest: float | None
    collisions: int
    frames: int
    reported: bool
    ms_per_frame: float
    slowest_ms: float


def tasks(floors: Iterator[Named], noises: Sequence[Noise], strategy: str) -> Iterator[Task]:
    """Runs for the farthest marker on each floor, and for another one."""
    for named in floors:
        start = named.floor.start or roomiest(named.floor, RADIUS)
        places = named.floor.markers or spread(named.floor, 4, RADIUS, start)
        for marker in (places[0], places[-1]):
            shortest = _shortest(named.floor, start, marker)
            for noise in noises:
                yield Task(named, start, marker, shortest, noise, strategy)


def _shortest(floor: OccupancyMap, start: MapPose, marker: Marker) -> float | None:
    """Length in metres of the shortest path for a disc on the true map, or None."""
    solid = np.pad(floor.obstacles, 1, constant_values=True)
    closed = (clearance(solid) <= RADIUS / floor.resolution)[1:-1, 1:-1]
    ends = floor.cell_at(start[0], start[1]), floor.cell_at(marker.x, marker.y)
    path = shortest_path(closed, *ends)
    return None if path is None else path.length * floor.resolution


def run(task: Task) -> Result:
    """Execute a run."""
    use(task.strategy)
    with tempfile.TemporaryDirectory() as folder:
        options = options_of(task, Path(folder))
        (node,) = agents(scene(options))
    robot = cast("ARobot", ARobot.thaw(node))
    robot.speed, robot.planner = SPEED, task.strategy
    robot.seek(task.marker.name)
    drive = Drive(_floor(task.named.name, task.named.floor), (task.marker,), robot, task.noise, 1)
    made = drive.go(MOST_FRAMES)
    return Result(
        task.named.name,
        task.marker.name,
        task.named.held_out,
        task.noise != Noise(),
        task.strategy,
        made.reached,
        _ratio(made.metres, task),
        _tour_ratio(task),
        round(made.metres, 2),
        None if task.shortest is None else round(task.shortest, 2),
        made.collisions,
        made.frames,
        made.reported,
        round(1000 * made.seconds / made.frames, 2),
        round(1000 * made.slowest, 1),
    )


def _ratio(metres: float, task: Task) -> float | None:
    """Ratio to the shortest path, or None without a path."""
    return round(metres / task.shortest, 3) if task.shortest else None


def _tour_ratio(task: Task) -> float | None:
    floor = task.named.floor
    if max(floor.cells.shape) * floor.resolution > LARGEST_TOUR_M:
        return None
    tour = tour_of(floor, task.start, RADIUS)
    return _ratio(tour.metres_to(task.marker.x, task.marker.y), task)


_FLOORS: dict[str, Floor] = {}


def _floor(name: str, floor: OccupancyMap) -> Floor:
    if name not in _FLOORS:
        _FLOORS.clear()
        _FLOORS[name] = Floor(floor)
    return _FLOORS[name]


def options_of(task: Task, folder: Path) -> dict[str, Any]:
    """Options of the robot's world for a task; writes the map into a folder."""
    floor = task.named.floor
    cells = np.select([floor.cells == 0, floor.cells == 100], [254, 0], 205).astype(np.uint8)
    picture = cells.T[::-1]
    high, wide = picture.shape
    (folder / "map.pgm").write_bytes(f"P5 {wide} {high} 255\n".encode() + picture.tobytes())
    keys = {
        "image": "map.pgm",
        "resolution": floor.resolution,
        "origin": [floor.x, floor.y, math.radians(floor.angle)],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    (folder / "map.yaml").write_text(json.dumps(keys))
    x, y, angle = task.start
    return {
        "map": str(folder / "map.yaml"),
        "start": f"{x}, {y}, {angle}",
        "markers": {task.marker.name: [task.marker.x, task.marker.y]},
        "parcels": "",
    }


def in_world(task: Task) -> dict[str, Any]:
    """The same run with `minerva run robot`: frames, distance in metres, and success."""
    with tempfile.TemporaryDirectory() as folder:
        options = options_of(task, Path(folder))
        place = f"{{{task.marker.name} = [{task.marker.x}, {task.marker.y}]}}"
        command = [
            sys.executable, "-m", "minerva_bus", "run", "robot", "--in-process", "--json",
            "--map", options["map"], "--start", options["start"], "--markers", place,
            "--parcels", "", "--frames", str(MOST_FRAMES),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    result = json.loads(done.stdout.splitlines()[-1])
    return {key: result[key] for key in ("reached", "frames", "distance_driven", "collisions")}


def summary(results: Sequence[Result]) -> dict[str, Any]:
    """Aggregated results of some runs."""
    ratios = [result.ratio for result in results if result.reached and result.ratio is not None]
    tours = [result.tour for result in results if result.tour is not None]
    metres = math.fsum(result.metres for result in results if result.shortest)
    shortest = math.fsum(result.shortest for result in results if result.shortest)
    return {
        "runs": len(results),
        "reached": sum(result.reached for result in results),
        "mean_ratio": _mean(ratios),
        "median_ratio": round(statistics.median(ratios), 3) if ratios else None,
        "ratio_of_sums": round(metres / shortest, 3) if shortest else None,
        "worst_ratio": max(ratios, default=None),
        "mean_tour": _mean(tours),
        "collisions": sum(result.collisions for result in results),
        "lost_and_not_reported": sum(not (result.reached or result.reported) for result in results),
        "ms_per_frame": _mean([result.ms_per_frame for result in results]),
    }


def _mean(numbers: Sequence[float]) -> float | None:
    return round(statistics.fmean(numbers), 3) if numbers else None


def _groups(results: Sequence[Result]) -> dict[str, dict[str, Any]]:
    """Summaries by seeds and noise, and by kind of floor."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        where = (
            f"{'held out' if result.held_out else 'tuned on'}{', noise' if result.noise else ''}"
        )
        groups.setdefault(where, []).append(result)
    for result in results:
        groups.setdefault(result.map.split("-")[0], []).append(result)
    return {name: summary(group) for name, group in groups.items()}


def _chosen(arguments: argparse.Namespace) -> list[Task]:
    floors: list[Named] = list(of_others())
    for seeds, held_out in ((arguments.seeds, False), (arguments.held_out, True)):
        for seed in (int(number) for number in seeds.split(",") if number):
            floors += generated(seed, held_out=held_out)
            if arguments.large:
                floors += large(seed, held_out=held_out)
    floors = [floor for floor in floors if arguments.only in floor.name]
    noises = (Noise(), NOISE) if arguments.noise else (Noise(),)
    return list(tasks(iter(floors), noises, arguments.strategy))


def main() -> None:
    parser = argparse.ArgumentParser(description=cast("str", __doc__).splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--held-out", default="11")
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--strategy", default="astar", choices=("astar", "nearest", "random"))
    parser.add_argument("--only", default="")
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    chosen = _chosen(arguments)
    results: list[Result] = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for task, result in zip(chosen, pool.map(run, chosen), strict=True):
            results.append(result)
            _say(result, in_world(task) if arguments.check else None, arguments.json)
    for name, group in _groups(results).items():
        print(json.dumps({"group": name, **group}) if arguments.json else f"{name}: {group}")


def _say(result: Result, world: dict[str, Any] | None, as_json: bool) -> None:
    if as_json:
        print(json.dumps(asdict(result) | ({"world": world} if world else {})), flush=True)
        return
    noise = " noise" if result.noise else ""
    print(
        f"{result.map:16} {result.marker:8}{noise:6} {'' if result.reached else 'NOT REACHED '}"
        f"ratio {_number(result.ratio)}  tour {_number(result.tour)}"
        f"  {result.metres:7.1f} of {_number(result.shortest)} m"
        f"  {result.frames:6} frames  {result.collisions} collisions"
        f"  {result.ms_per_frame:5.1f} ms, at most {result.slowest_ms:.0f}"
        f"{'  reported' if result.reported else ''}{f'  world: {world}' if world else ''}",
        flush=True,
    )


def _number(number: float | None) -> str:
    return "     -" if number is None else f"{number:6.2f}"


if __name__ == "__main__":
    main()
