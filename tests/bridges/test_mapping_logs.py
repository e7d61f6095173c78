"""Logs of simulated drives through other buildings: `minerva map` draws the floor plan."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from recorded import DATA, flaser, messages, robot_laser, write, write_bag

from minerva_agents.robot.map_recording import map_recording
from minerva_agents.robot.maps import FREE, OCCUPIED, load_map
from minerva_services.physics.arena import Arena
from minerva_services.physics.walls import wall_segments
from tests.bridges.ros2_rig import house

DEPOT = DATA / "ros_maps" / "depot.yaml"
RANGE, RADIUS, STOPS = 12.0, 0.2, 16
SICK_SEES_NOTHING = 81.91
HOUSE, DEPOT_PARTS = (0.99, 0.99, 0.99, 0.9), (0.99, 0.99, 0.95, 0.7)
"""Minimum overlaps; measured: 1, 1, 1, 0.94 and 1, 1, 0.977, 0.74."""


@dataclass(frozen=True)
class Building:
    """A floor plan, and the stops of a robot in it."""

    plan: object
    arena: Arena
    poses: tuple

    def scan(self, pose, beams, first, step):
        name = f"at {pose}"
        if name not in self.arena.bodies:
            self.arena.add_body(name, pose[0], pose[1], pose[2], RADIUS)
        distances = self.arena.scan(name, beams, first, step, RANGE)
        self.arena.remove_body(name)
        return distances


@cache
def building(path):
    plan = load_map(path)
    arena = Arena()
    cells = np.where(plan.cells == FREE, 0, 100)
    arena.add_walls(wall_segments(cells, plan.resolution, plan.x, plan.y, plan.angle))
    near = dilated(cells != 0, math.ceil(1.2 * RADIUS / plan.resolution))
    free, chance = np.argwhere(~near), np.random.default_rng(5)
    chosen = free[np.sort(chance.integers(len(free), size=STOPS))].tolist()
    turns = chance.uniform(-180.0, 180.0, STOPS).tolist()
    places = [plan.centre_of(tuple(cell)) for cell in chosen]
    return Building(plan, arena, tuple((*at, turn) for at, turn in zip(places, turns, strict=True)))


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    return building(house(tmp_path_factory.mktemp("house")))


@pytest.fixture(scope="module")
def depot():
    if not DEPOT.exists():
        pytest.skip(f"{DEPOT} is not there")
    return building(DEPOT)


def dilated(cells, reach):
    """All cells within `reach` rows and columns of a true cell."""
    grown = np.pad(cells, reach)
    for axis in (0, 1):
        grown = np.any([np.roll(grown, by, axis) for by in range(-reach, reach + 1)], axis=0)
    return grown[reach:-reach, reach:-reach]


def at_plan(plan, drawn, code):
    """Plan cells under the drawn cells of a code, (n, 2), and the number of drawn cells."""
    cells = [
        plan.cell_at(*drawn.centre_of(tuple(index))) for index in np.argwhere(drawn.cells == code)
    ]
    rows, columns = plan.cells.shape
    return np.array([(r, c) for r, c in cells if 0 <= r < rows and 0 <= c < columns]), len(cells)


def overlap(plan, drawn):
    """Overlap of a drawn map with the plan, as four fractions.

    Drawn walls that are walls, drawn ground that is free, walls beside drawn ground that are drawn, and
    free ground that is drawn. Walls have a tolerance of 0.1 m.
    """
    solid, reach = plan.cells != FREE, math.ceil(0.1 / plan.resolution)
    walls, count = at_plan(plan, drawn, OCCUPIED)
    ground, _ = at_plan(plan, drawn, FREE)
    marked, seen = np.zeros_like(solid), np.zeros_like(solid)
    marked[tuple(walls.T)] = seen[tuple(ground.T)] = True
    edge = solid & dilated(~solid, 1) & dilated(seen, 1)
    are_walls = dilated(solid, reach)[tuple(walls.T)].sum() / count
    is_free = dilated(~solid, 1)[tuple(ground.T)].mean()
    return are_walls, is_free, dilated(marked, reach)[edge].mean(), seen[~solid].mean()


def mapped(log, folder):
    map_recording(log, folder / "map.pgm", 0.05, 0.0, 0.0, None)
    return load_map(folder / "map.yaml")


def carmen(place, folder, beams, yaw):
    """A CARMEN log of a 180-degree laser that faces ahead or to the left."""
    step = 180.0 / (beams - beams % 2)
    lines = []
    for number, (x, y, angle) in enumerate(place.poses):
        distances = place.scan((x, y, angle), beams, yaw - 90.0, step)
        ranges = np.where(distances < RANGE, distances, SICK_SEES_NOTHING).round(3)
        robot, laser = (x, y, math.radians(angle)), (x, y, math.radians(angle + yaw))
        options = {"first": -math.pi / 2, "step": math.radians(step)} if yaw else {}
        line = robot_laser(ranges, laser, robot, **options) if yaw else flaser(ranges, robot)
        lines.append(line.replace(" 1.0 host 1.0", f" {number}.0 host {number}.0"))
    return write(folder / "drive.log", *lines)


def bag(place, folder, beams, yaw, suffix, told_yaw=None):
    """A bag of a 360-degree laser that is mounted at an angle."""
    types, store = messages(ros1=suffix == "bag")
    step, first = 2 * math.pi / beams, -2 * math.pi / beams * (beams // 2)
    turned = math.radians(yaw if told_yaw is None else told_yaw)
    said = [(0.0, "/tf_static", types.transforms(("base_link", "laser", 0.0, 0.0, turned, 0.0)))]
    angles = {"angle_min": first, "angle_max": -first, "angle_increment": step}
    for time, (x, y, angle) in enumerate(place.poses, 1):
        ranges = place.scan((x, y, angle), beams, yaw + math.degrees(first), math.degrees(step))
        said.append((time, "/odom", types.odometry(x, y, math.radians(angle), time=time)))
        said.append((time, "/scan", types.scan(ranges, time=time, range_max=RANGE, **angles)))
    return write_bag(folder / f"drive.{suffix}", store, said)


@pytest.mark.parametrize(("beams", "yaw"), [(180, 0.0), (360, 90.0), (361, 0.0), (720, 90.0)])
def test_a_carmen_log_of_a_house(tmp_path, home, beams, yaw):
    drawn = mapped(carmen(home, tmp_path, beams, yaw), tmp_path)
    assert all(
        share >= least for share, least in zip(overlap(home.plan, drawn), HOUSE, strict=True)
    )


@pytest.mark.parametrize(
    ("beams", "yaw", "suffix"),
    [(180, 90.0, "bag"), (360, 90.0, "db3"), (361, -90.0, "mcap"), (720, 30.0, "bag")],
)
def test_a_bag_of_a_house(tmp_path, home, beams, yaw, suffix):
    pytest.importorskip("rosbags")
    drawn = mapped(bag(home, tmp_path, beams, yaw, suffix), tmp_path)
    assert all(
        share >= least for share, least in zip(overlap(home.plan, drawn), HOUSE, strict=True)
    )


def test_a_depot_by_both(tmp_path, depot):
    pytest.importorskip("rosbags")
    for log in (carmen(depot, tmp_path, 361, 90.0), bag(depot, tmp_path, 360, 90.0, "db3")):
        shares = overlap(depot.plan, mapped(log, tmp_path))
        assert all(share >= least for share, least in zip(shares, DEPOT_PARTS, strict=True))


def test_a_laser_with_a_wrong_declared_angle_maps_another_house(tmp_path, home):
    pytest.importorskip("rosbags")
    drawn = mapped(bag(home, tmp_path, 180, 90.0, "db3", told_yaw=80.0), tmp_path)
    assert overlap(home.plan, drawn)[0] < 0.7
