"""Expected ratio of driven distance to shortest path, over all places of a marker on each floor.

    python -m agents.benchmarks.exploration_places [--json] [--seeds 1] [--large] [--noise]
                                            [--maps NAME,...] [--strategy astar|nearest|random]
                                            [--jobs 2] [--bounds]

`agents.benchmarks.exploration` drives to two markers per floor; this benchmark averages over a
lattice of places, so its results depend less on luck. `far` are the places in the far half.
`tour` is the ratio of a robot that knows the floor and drives a tour of views; `bound` is below
the ratio of every robot with this camera, also of one that knows the floor (see
`exploring.places`). `--bounds` computes only the bounds, and drives nowhere.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import cast

import numpy as np

from agents.benchmarks.exploration import LARGEST_TOUR_M, NOISE, RADIUS, SPEED, Task, options_of
from agents.benchmarks.exploring.driving import Floor, Noise
from agents.benchmarks.exploring.floors import Named, generated, large, of_others
from agents.benchmarks.exploring.places import Expected, Places, Watched
from agents.benchmarks.exploring.strategies import use
from agents.benchmarks.exploring.tours import tour_of
from minerva_agents.robot.maps import Marker, roomiest
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import scene
from minerva_bus.grammar.scene import agents

MAX_FRAMES = 100_000


@dataclass(frozen=True, slots=True)
class Result:
    """Expected ratios on a floor; `unseen` places count with all metres driven."""

    map: str
    noise: bool
    strategy: str
    ratio: Expected
    tour: Expected | None
    bound: Expected
    places: int
    unseen: int
    metres: float
    frames: int
    collisions: int


def run(task: tuple[Named, Noise, str]) -> Result:
    """Search a floor until every place has been seen."""
    named, noise, strategy = task
    use(strategy)
    floor = named.floor
    start = floor.start or roomiest(floor, RADIUS)
    places = Places(floor, start, RADIUS)
    farthest = int(np.argmax(places.shortest))
    marker = Marker("A", *places.points[farthest].tolist())
    with tempfile.TemporaryDirectory() as folder:
        options = options_of(Task(named, start, marker, None, noise, strategy), Path(folder))
        (node,) = agents(scene(options))
    robot = cast("ARobot", ARobot.thaw(node))
    robot.speed, robot.planner = SPEED, strategy
    robot.seek(marker.name)
    drive = Watched(Floor(floor), places, robot, noise, 1)
    drive.see_all(MAX_FRAMES)
    unseen = np.isnan(drive.metres)
    tour = None
    if max(floor.cells.shape) * floor.resolution <= LARGEST_TOUR_M:
        metres = tour_of(floor, start, RADIUS).metres_to_each(places.cells)
        tour = Expected.of(metres, places.shortest)
    return Result(
        named.name,
        noise != Noise(),
        strategy,
        Expected.of(np.where(unseen, drive.run.metres, drive.metres), places.shortest),
        tour,
        places.bound(),
        len(unseen),
        int(unseen.sum()),
        round(drive.run.metres, 2),
        drive.run.frames,
        drive.run.collisions,
    )


def _line(name: str, results: Sequence[Result]) -> str:
    """Means of some results as text: all places, and those in the far half."""
    columns = [f"{name:16}"]
    for what in ("ratio", "tour", "bound"):
        values = [value for result in results if (value := getattr(result, what)) is not None]
        for half in ("all", "far"):
            mean = statistics.fmean(getattr(value, half) for value in values) if values else None
            columns.append(f"{what} {half} {'    -' if mean is None else f'{mean:5.2f}'}")
    metres = statistics.fmean(result.metres for result in results)
    columns.append(f"{metres:7.1f} m {sum(result.unseen for result in results)} unseen")
    return "  ".join(columns) + f"  {sum(result.collisions for result in results)} collisions"


def bound_of(named: Named) -> Expected:
    """The bound for every robot on a floor, from the start of the benchmark."""
    start = named.floor.start or roomiest(named.floor, RADIUS)
    return Places(named.floor, start, RADIUS).bound()


def _print_bounds(floors: Sequence[Named], *, as_json: bool) -> None:
    bounds = {floor.name: bound_of(floor) for floor in floors}
    for name, bound in bounds.items():
        row = {"map": name, "bound": asdict(bound)}
        shown = f"{name:16}  bound all {bound.all:5.2f}  bound far {bound.far:5.2f}"
        print(json.dumps(row) if as_json else shown, flush=True)
    if bounds and not as_json:
        every = statistics.fmean(bound.all for bound in bounds.values())
        far = statistics.fmean(bound.far for bound in bounds.values())
        print(f"{'mean':16}  bound all {every:5.2f}  bound far {far:5.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=cast("str", __doc__).splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--bounds", action="store_true")
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--maps", default="")
    parser.add_argument("--strategy", default="astar", choices=("astar", "nearest", "random"))
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    floors: list[Named] = list(of_others())
    for seed in (int(number) for number in arguments.seeds.split(",") if number):
        floors += generated(seed, held_out=False)
        if arguments.large:
            floors += large(seed, held_out=False)
    noise = NOISE if arguments.noise else Noise()
    parts = arguments.maps.split(",")
    floors = [floor for floor in floors if any(part in floor.name for part in parts)]
    if arguments.bounds:
        _print_bounds(floors, as_json=arguments.json)
        return
    chosen = [(floor, noise, arguments.strategy) for floor in floors]
    results: list[Result] = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for result in pool.map(run, chosen):
            results.append(result)
            line = json.dumps(asdict(result)) if arguments.json else _line(result.map, [result])
            print(line, flush=True)
    if results and not arguments.json:
        print(_line("all", results))


if __name__ == "__main__":
    main()
