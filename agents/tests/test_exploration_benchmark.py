"""The exploration benchmark reports the same results as the robot itself."""

import dataclasses
import json

import numpy as np
import pytest

from agents.benchmarks.exploration import RADIUS, SPEED, Task, _shortest, main, options_of, run
from agents.benchmarks.exploring.driving import Drive, Floor, Noise
from agents.benchmarks.exploring.floors import Named, floor_of
from agents.benchmarks.exploring.results import Result, append_row, read_rows, summary
from agents.benchmarks.exploring.tours import Tour
from minerva_agents.robot.maps import Marker
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import scene
from minerva_bus.grammar.scene import agents

MARKER = Marker("A", 2.0, 2.0)


RESULT = Result(
    "m", "A", False, False, "astar", True, 2.0, 3.0, 4.0, 2.0, 0, 9, False, "", 1.0, 1.0
)


def task_of(named):
    return Task(named, (1.0, 1.0, 0.0), MARKER, None, Noise(), "astar")


@pytest.fixture
def drive(tmp_path):
    """A robot in a hall of 4 m that searches for a marker that does not exist."""
    floor = floor_of("hall", 4.0, 1)
    named = Named("hall-4-1", floor, held_out=False)
    task = task_of(named)
    (node,) = agents(scene(options_of(task, tmp_path)))
    robot = ARobot.thaw(node)
    robot.speed = SPEED
    robot.seek(MARKER.name)
    return robot, Drive(Floor(floor), (), robot, Noise(), 1)


def test_a_robot_that_gives_up_has_reported_it(drive):
    robot, run = drive[0], drive[1].go(6000)
    assert (run.reached, run.reported, robot.objective) == (False, True, "")
    assert "looked everywhere" in run.reason
    assert run.frames < 6000


def test_a_robot_that_searches_again_has_not_reported_yet(drive):
    robot, run = drive[0], drive[1]
    robot.searches = 1
    assert not run.go(10).reported


def test_a_run_is_repeatable_and_its_line_is_json_also_without_a_path():
    task = task_of(Named("hall-4-1", floor_of("hall", 4.0, 1), held_out=False))
    first, other = (dataclasses.replace(run(task), ms_per_frame=0.0, slowest_ms=0.0) for _ in "12")
    assert first == other
    assert (first.reached, first.ratio, first.tour) == (True, None, None)
    json.dumps(dataclasses.asdict(first), allow_nan=False)
    assert summary([first])["mean_ratio"] is None


def test_lost_runs_are_those_neither_reached_nor_reported():
    reported = dataclasses.replace(RESULT, reached=False, reported=True)
    lost = dataclasses.replace(RESULT, reached=False)
    totals = summary([RESULT, reported, lost])
    assert (totals["runs"], totals["reached"], totals["lost_and_not_reported"]) == (3, 1, 1)
    assert (totals["mean_ratio"], totals["mean_tour"]) == (2.0, 3.0)


def test_rows_are_in_the_file_as_soon_as_a_run_is_complete(tmp_path):
    path = tmp_path / "rows.jsonl"
    other = dataclasses.replace(RESULT, marker="B", ratio=None, reason="not found", reported=True)
    assert read_rows(path) == []
    append_row(path, RESULT)
    append_row(path, other)
    assert read_rows(path) == [RESULT, other]


def test_an_interrupted_benchmark_continues_with_the_missing_runs(tmp_path, monkeypatch, capsys):
    path = tmp_path / "rows.jsonl"
    words = ["exploration", "--maps", "hall-10-", "--held-out", "", "--no-tour", "--json"]
    monkeypatch.setattr("sys.argv", [*words, "--rows", str(path)])
    append_row(path, dataclasses.replace(RESULT, map="hall-10-1", marker="A", metres=-1.0))
    main()
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["marker"] for row in rows if "marker" in row] == ["D"]
    assert {"map", "reached", "ratio", "collisions", "frames", "reported"} <= rows[0].keys()
    assert rows[1]["runs"] == 2
    assert next(result.metres for result in read_rows(path)) == -1.0


def test_halls_of_different_seeds_differ_in_the_start_alone():
    first, same, other = (floor_of("hall", 10.0, seed) for seed in (1, 1, 2))
    assert first.start == same.start != other.start
    assert (first.cells == other.cells).all()
    assert all(0.5 < metres < 9.5 for metres in (*first.start[:2], *other.start[:2]))


def test_a_tour_goes_straight_to_a_marker_that_is_in_view_from_its_first_stop():
    """The shortest path to a distant marker uses other steps, hence the tolerance of 10 %."""
    floor = floor_of("rooms", 10.0, 1)
    start, near, far = (1.5, 1.5, 0.0), Marker("A", 2.0, 2.0), Marker("B", 8.5, 8.5)
    tour = Tour(floor, start, RADIUS)
    assert tour.metres_to(near.x, near.y) < 6.0
    assert tour.metres_to(far.x, far.y) > 0.9 * _shortest(floor, start, far)


def test_a_tour_sees_all_of_the_floor():
    """The path to any marker is at most the tour plus the longest path to it."""
    floor = floor_of("pillars", 10.0, 1)
    tour = Tour(floor, (1.0, 1.0, 0.0), RADIUS)
    places = [floor.cell_at(x + 0.5, y + 0.5) for x in range(1, 9) for y in range(1, 9)]
    assert tour.metres_to_each(np.array(places)).max() < 10 * 10 / 4.0 + 15.0
