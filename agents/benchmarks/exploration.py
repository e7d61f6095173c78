"""Distance that a robot drives to find a marker on an unknown floor.

    python -m agents.benchmarks.exploration [--json] [--seeds 1,2] [--held-out 11,12] [--noise]
                                     [--strategy astar|nearest|random] [--maps NAME,...] [--large]
                                     [--check] [--no-tour] [--rows FILE] [--jobs 2]

Each floor is explored for two markers: the farthest one, which `minerva run robot --map` selects,
and another one. `ratio` is the driven distance divided by the length of the shortest path on the
true map, with moves to eight neighbours, for a disc of the robot's radius. A run ends when the
robot arrives or gives up with eUnreachable (`reported`), or after a number of frames that the floor
determines: the robot's patience, and a search that takes 2 m of driving for each square metre.
`tour` is the same ratio for a robot that knows the map, but not the marker, and drives a tour with
a view of the complete floor. It is omitted for floors that are too large.

The strategy is tuned on the floors of --seeds and not on those of --held-out. Halls of different
seeds differ only in the start. `--maps` selects floors by parts of their names, and `--check` also
runs them in the complete world.

Rows appear in the order in which runs end. `--rows` appends each of them to a file of JSON lines
and skips the runs that the file already has, so an interrupted benchmark continues where it ended.
Delete the file after a change of the robot.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from agents.benchmarks.exploring.driving import DT, Drive, Floor, Noise
from agents.benchmarks.exploring.floors import Named, generated, large, of_others
from agents.benchmarks.exploring.results import Result, append_row, groups, read_rows, show
from agents.benchmarks.exploring.strategies import use
from agents.benchmarks.exploring.tours import tour_of
from minerva_agents.robot.approach import METRES_PER_NEWS, patience
from minerva_agents.robot.grid import clearance
from minerva_agents.robot.maps import MapPose, Marker, OccupancyMap, roomiest, spread
from minerva_agents.robot.planning import shortest_path
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import scene
from minerva_bus.grammar.scene import agents

RADIUS, SPEED = 0.18, 0.8
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
    with_tour: bool = True

    @property
    def key(self) -> tuple[str, str, bool, str]:
        """Identity of the run, equal to that of its result."""
        return self.named.name, self.marker.name, self.noise != Noise(), self.strategy


def tasks(
    floors: Iterable[Named], noises: Sequence[Noise], strategy: str, *, with_tour: bool = True
) -> Iterator[Task]:
    """Runs for the farthest marker on each floor, and for another one."""
    for named in floors:
        start = named.floor.start or roomiest(named.floor, RADIUS)
        places = named.floor.markers or spread(named.floor, 4, RADIUS, start)
        for marker in (places[0], places[-1]):
            shortest = _shortest(named.floor, start, marker)
            for noise in noises:
                yield Task(named, start, marker, shortest, noise, strategy, with_tour)


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
    made = drive.go(_most_frames(robot, task.named))
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
        made.reason,
        round(1000 * made.seconds / made.frames, 2),
        round(1000 * made.slowest, 1),
    )


def _most_frames(robot: ARobot, named: Named) -> int:
    """Frames of the robot's patience and of one search of the whole floor.

    A longer run is neither reached nor reported.
    """
    seconds = patience(robot) + _area(named) * METRES_PER_NEWS / robot.speed
    return math.ceil(seconds / DT)


def _area(named: Named) -> float:
    """Free area of a floor in m²."""
    return np.count_nonzero(~named.floor.obstacles) * named.floor.resolution**2


def _ratio(metres: float, task: Task) -> float | None:
    """Ratio to the shortest path, or None without a path."""
    return round(metres / task.shortest, 3) if task.shortest else None


def _tour_ratio(task: Task) -> float | None:
    floor = task.named.floor
    if not task.with_tour or max(floor.cells.shape) * floor.resolution > LARGEST_TOUR_M:
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


def in_world(task: Task, frames: int) -> dict[str, Any]:
    """The same run with `minerva run robot`, with at most so many frames: figures and success."""
    with tempfile.TemporaryDirectory() as folder:
        options = options_of(task, Path(folder))
        place = f"{{{task.marker.name} = [{task.marker.x}, {task.marker.y}]}}"
        command = [
            sys.executable, "-m", "minerva_bus", "run", "robot", "--in-process", "--json",
            "--map", options["map"], "--start", options["start"], "--markers", place,
            "--parcels", "", "--frames", str(frames),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    result = json.loads(done.stdout.splitlines()[-1])
    return {key: result[key] for key in ("reached", "frames", "distance_driven", "collisions")}


def _chosen(arguments: argparse.Namespace) -> list[Task]:
    floors: list[Named] = list(of_others())
    for seeds, held_out in ((arguments.seeds, False), (arguments.held_out, True)):
        for seed in (int(number) for number in seeds.split(",") if number):
            floors += generated(seed, held_out=held_out)
            if arguments.large:
                floors += large(seed, held_out=held_out)
    parts = arguments.maps.split(",")
    floors = [floor for floor in floors if any(part in floor.name for part in parts)]
    # Small floors first, so that an interrupted benchmark has the rows of as many as possible.
    floors.sort(key=_area)
    noises = (Noise(), NOISE) if arguments.noise else (Noise(),)
    return list(tasks(floors, noises, arguments.strategy, with_tour=arguments.tour))


def main() -> None:
    arguments = _arguments()
    rows: Path | None = arguments.rows
    chosen = _chosen(arguments)
    keys = {task.key for task in chosen}
    results = [result for result in read_rows(rows) if result.key in keys]
    done = {result.key for result in results}
    left = [task for task in chosen if task.key not in done]
    for task, result in _executed(left, arguments.jobs):
        append_row(rows, result)
        results.append(result)
        # The complete world is given twice the frames of the simulation.
        world = in_world(task, 2 * result.frames) if arguments.check else None
        show(result, world, arguments.json)
    for name, group in groups(results).items():
        print(json.dumps({"group": name, **group}) if arguments.json else f"{name}: {group}")


def _executed(chosen: Sequence[Task], jobs: int) -> Iterator[tuple[Task, Result]]:
    """Tasks with their results, in the order in which they end; one job needs no process."""
    if jobs == 1:
        yield from ((task, run(task)) for task in chosen)
        return
    with ProcessPoolExecutor(jobs) as pool:
        futures = {pool.submit(run, task): task for task in chosen}
        yield from ((futures[future], future.result()) for future in as_completed(futures))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=cast("str", __doc__).splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--held-out", default="11")
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--strategy", default="astar", choices=("astar", "nearest", "random"))
    parser.add_argument("--maps", default="")
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--no-tour", dest="tour", action="store_false")
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    main()
