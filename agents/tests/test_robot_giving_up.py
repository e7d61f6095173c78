"""A robot that cannot reach its objective reports that and stops, whatever the reason."""

import numpy as np
import pytest
from floor_plans import FloorPlan
from floor_simulator import Simulator
from robot_steps import after, robot

from minerva_agents.robot.approach import (
    COUNT_FRAMES,
    MAX_FAILURES,
    MAX_SEARCHES,
    METRES_PER_NEWS,
    gives_up,
    patience,
    restart_search,
)
from minerva_agents.robot.control import search_and_approach
from minerva_agents.robot.exploration import Goal
from minerva_agents.robot.grid import CLOSED, FREE, MARKER, SEEN
from minerva_agents.robot.maps import OccupancyMap
from minerva_agents.robot.pose import STAY, action_of, move_of
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.vocabulary import eCamera, eDecide
from minerva_agents.robot.world import scene
from minerva_bus import Context, Frame, World, evolve, run
from minerva_bus.grammar.scene import agents

STANDING = {"action": action_of(STAY, "r", 0.18), "speed": 0.5, "objective": "kitchen"}


def decision(string, frame=1, dt=0.1):
    made = evolve(string, [eDecide()], [ARobot], Frame(frame, dt))
    return [str(event) for event in made.emitted.get("r", ())]


def test_it_gives_up_after_some_searches():
    state = {**STANDING, "searches": MAX_SEARCHES + 1}
    (said,) = decision(robot(**state))
    assert 'eUnreachable<marker="kitchen", why="not found, though the robot has looked' in said
    now = after(robot(**state), eDecide())
    assert (now.objective, now.searches, now.way) == ("", 0, [])
    assert move_of(now.action) == STAY
    assert decision(now.string) == []


def test_it_gives_up_a_marker_that_it_sees_and_cannot_get_to():
    grid = np.full((40, 40), FREE, np.int16)
    grid[:, 30] = 9
    grid[20, 35] = 16
    (said,) = decision(robot(grid, **STANDING, failures=MAX_FAILURES))
    assert 'why="no way to it after 12 attempts"' in said


def test_it_gives_up_a_marker_that_it_has_seen_and_does_not_reach():
    """Each plan succeeds and is abandoned, so that no failure counts."""
    seeker, frame = searching(markers=("kitchen",), stale=9.0), 0
    seeker.writable("grid")[20, 35] = MARKER
    while not gives_up(seeker, Context(Frame(frame, 1.0), "#r")):
        frame += 1
        assert frame <= patience(seeker)
    assert (seeker.objective, frame) == ("", int(patience(seeker) - 9.0))


def test_the_time_of_a_search_does_not_count_for_the_approach():
    string = robot(**STANDING, stale=200.0)
    for dist, stale in ((3.0, 0.1), (0.3, 0.0)):  # on the way, and at the marker
        string = after(string, eCamera("kitchen", dist, 0.0), eDecide()).string
        assert next(iter(agents(string))).state["stale"] == pytest.approx(stale)


def test_a_robot_off_its_map_gives_up():
    state = {**STANDING, "row": -3.0, "most_known": 0}
    assert decision(robot(**state, stale=500.0)) != []
    assert decision(robot(**state, stale=100.0)) == []


def test_it_gives_up_an_errand_and_goes_on_with_what_it_did_before():
    state = {**STANDING, "target": "store", "later": "lab", "searches": MAX_SEARCHES + 1}
    (said,) = decision(robot(**state))
    assert 'eGivenUp<source="kitchen", target="store"' in said
    assert after(robot(**state), eDecide()).objective == "lab"


@pytest.mark.parametrize("planner", ["astar", "random"])
def test_it_gives_up_when_nothing_new_is_seen_for_long(planner):
    grid = np.full((40, 40), SEEN, np.int16)
    state = {**STANDING, "planner": planner, "most_known": 3200}
    assert decision(robot(grid, **state, stale=500.0)) != []
    assert decision(robot(grid, **state, stale=200.0)) == []


def test_a_repeated_search_ends_sooner_without_news():
    """Ten crossings of the grid of 4 m at 0.5 m/s are 113 s."""
    grid = np.full((40, 40), SEEN, np.int16)
    state = {**STANDING, "searches": 1, "most_known": 3200}
    assert decision(robot(grid, **state, stale=115.0)) != []
    assert decision(robot(grid, **state, stale=110.0)) == []


def test_news_pay_for_driving():
    grid = np.full((40, 40), SEEN, np.int16)
    now = after(robot(grid, **STANDING, most_known=3000, stale=200.0), eDecide(), frame=20)
    paid = 200 * 0.1**2 * METRES_PER_NEWS / 0.5
    assert (now.most_known, now.stale) == (3200, pytest.approx(200.1 - paid))


def searching(**state):
    (node,) = agents(robot(**STANDING, **state))
    return ARobot.thaw(node)


def test_single_cells_of_news_do_not_prolong_a_search_without_limit():
    """Whenever the robot is about to give up, one more cell becomes known or is inspected."""
    seeker, seconds, dt, shown = searching(), 0.0, 1.0, 0
    area = seeker.grid.size * seeker.cell**2
    limit = patience(seeker) + 2 * area * METRES_PER_NEWS / seeker.speed
    while not gives_up(seeker, Context(Frame(round(seconds), dt), "#r")):
        seconds += dt
        assert seconds <= limit + COUNT_FRAMES * dt
        if seeker.stale > patience(seeker) - 2 * COUNT_FRAMES * dt:
            cell, shown = shown % seeker.grid.size, shown + 1
            seeker.writable("grid").flat[cell] = FREE if shown <= seeker.grid.size else SEEN
    assert shown > 1
    assert seeker.objective == ""


def test_a_restarted_search_may_inspect_everything_again():
    grid = np.full((40, 40), SEEN, np.int16)
    seeker = searching(grid=grid, most_known=3200, stale=400.0)
    restart_search(seeker)
    # Also in the frames before the next count of news.
    assert not gives_up(seeker, Context(Frame(COUNT_FRAMES - 1, 0.1), "#r"))
    assert not gives_up(seeker, Context(Frame(COUNT_FRAMES, 0.1), "#r"))
    assert (seeker.most_known, seeker.stale, seeker.searches) == (3200, 0.0, 1)


GOAL = Goal(((20, 35),), 0.0, 1.0)


@pytest.mark.parametrize(
    ("goal", "state", "been", "searches"),
    [
        (GOAL, {"failures": 2}, (7, 20 * 40 + 35), 0),
        (None, {"failures": 2}, (), 1),
        (None, {"failures": 1}, (7,), 0),
        (None, {"failures": 2, "markers": ("kitchen",)}, (7,), 0),
    ],
    ids=["a viewpoint without a path", "no viewpoint", "too few failures", "a known marker"],
)
def test_only_a_search_without_viewpoints_is_restarted(goal, state, been, searches):
    grid = np.full((40, 40), SEEN, np.int16)
    grid[:, 28:] = 9
    grid[0, 0] = CLOSED
    if "markers" in state:
        grid[20, 35] = MARKER
    seeker = searching(grid=grid, been=(7,), dull=(8,), **state)
    search_and_approach(seeker, Context(Frame(1, 0.1), "#r"), lambda state: goal)
    assert (seeker.been, seeker.searches) == (been, searches)
    # A restarted search inspects everything again, also where a turn revealed nothing.
    assert (seeker.dull == (), SEEN not in seeker.grid) == (searches > 0, searches > 0)
    assert (CLOSED in seeker.grid) == (seeker.failures < 3)


def test_in_a_room_without_the_marker_it_stops(tmp_path):
    cells = np.full((70, 70), 100, np.int16)
    cells[2:-2, 2:-2] = 0
    floor = OccupancyMap(cells, 0.05)
    image = np.where(floor.cells.T[::-1] == 0, 254, 0).astype(np.uint8)
    (tmp_path / "room.pgm").write_bytes(b"P5\n70 70\n255\n" + image.tobytes())
    options = {"map": str(tmp_path / "room.pgm"), "parcels": "", "markers": {"here": [1.0, 1.0]}}
    simulator = Simulator(floor, [], scene(options), "nowhere")
    run = simulator.go(1500)
    assert run.reached, "the simulator stops at the first thing that the robot says"
    assert run.metres < 60
    (node,) = agents(simulator.scene)
    assert node.state["objective"] == ""


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", range(4))
def test_a_marker_that_no_camera_recognises_is_reported(seed, tmp_path):
    path = str(FloorPlan(seed).save(tmp_path))
    world = World.load("robot", map=path, objective="bed", parcels="", camera_miss=1.0)
    result = run(world, frames=20_000)
    assert "eUnreachable" in result.ended
    assert result.frames < 20_000
