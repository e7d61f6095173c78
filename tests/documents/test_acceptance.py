"""The command that plays test suites of others (tools/acceptance), with a small suite."""

import json
from functools import partial

import numpy as np
import pytest

from tools.acceptance import library, routing, vehicles
from tools.acceptance.__main__ import PAGE, SUITES, main, section
from tools.acceptance.suite import LFS_POINTER, Outcome

FIGURES = {
    "ants": {"pile 1": 104, "pile 2": 108, "pile 3": 98},
    "flocking": {"order": 0.14, "distance": 5.37},
    "heatbugs": {"unhappiness": 23.0, "median": 22.31, "distance": 5.03},
    "wolf_sheep": {"sheep": 48, "wolves": 57, "grass": 71},
    "aids": {"infected": 8, "known": 0, "coupled": 36},
}
"""Statistics of models after the first steps."""


def play(monkeypatch, capsys, folder, *names):
    """The exit code and the output."""
    monkeypatch.setattr("sys.argv", ["acceptance", "--folder", str(folder), *names])
    return main(), capsys.readouterr().out


def test_suites_are_played_or_skipped_by_name(tmp_path, monkeypatch, capsys):
    played = partial(play, monkeypatch, capsys, tmp_path)
    (suite := tmp_path / "msgpack-test-suite" / "dist").mkdir(parents=True)
    groups = {"numbers": [{"number": 1, "msgpack": ["01", "cc-01"]}, {"nil": None, "msgpack": []}]}
    (suite / "msgpack-test-suite.json").write_text(json.dumps(groups))
    (data := tmp_path / "mcap" / "tests" / "conformance" / "data").mkdir(parents=True)
    (data / "pointer.mcap").write_bytes(LFS_POINTER)
    code, output = played()
    assert code == 1
    assert "msgpack: 2 cases: 1 passed, 0 expected difference, 1 failed" in output
    assert "FAILED numbers None: it is written as c0" in output
    assert "mcap: skipped" in output
    assert "git lfs pull" in output
    assert played("gpsd") == (0, f"gpsd: skipped: no {tmp_path}/gpsd/test/daemon; clone"
                                 " https://github.com/ntpsec/gpsd\n")  # fmt: skip


def test_the_page_has_a_score_of_every_suite():
    page = PAGE.read_text(encoding="utf-8")
    assert section(page, []) in page  # Suites that are not played keep their scores.
    rows = [line for line in page.splitlines() if "| [" in line]
    assert [row.split("`")[1] for row in rows] == list(SUITES)
    assert all(row.count("|") == 4 + len(Outcome) for row in rows)


@pytest.mark.parametrize(
    ("after", "problem"),
    [
        ([(0, 0), (1, 0)], None),
        ([(1, 0), (2, 0)], None),  # one follows the other
        ([(1, 0), (0, 0)], "changed places"),
        ([(1, 0), (1, 0)], "two robots are in a cell"),
        ([(0, 0), (3, 0)], "further than to the next cell"),
        ([(0, 1), (1, 0)], "wall"),
        ([(-1, 0), (1, 0)], "wall"),
    ],
)
def test_collisions_of_robots_are_seen(after, problem):
    free = np.array([[True] * 4, [False] * 4])
    seen = list(routing.collisions(free, np.array([(0, 0), (1, 0)]), np.array(after)))
    assert (problem in seen[0]) if problem else not seen


@pytest.mark.slow  # compiles the planner
def test_robots_pass_each_other_in_a_corridor():
    pytest.importorskip("numba")
    ends = np.array([(0, 0), (6, 0)])
    result = routing.played("corridor", [".......", "@@@.@@@"], ends, ends[::-1])
    assert result.outcome is Outcome.PASSED
    assert 7 < int(result.figures["makespan"]) < 20


def test_statistics_differ_if_their_distributions_do():
    numbers = list(map(float, range(40)))
    outcomes = [
        library.compared("size", numbers, [other + shift for other in numbers], 0.01).outcome
        for shift in (3, 30)
    ]
    assert outcomes == [Outcome.PASSED, Outcome.FAILED]


@pytest.mark.parametrize(("name", "steps"), [("ants", 3), ("flocking", 2), ("heatbugs", 2),
                                             ("wolf_sheep", 3), ("aids", 3)])  # fmt: skip
def test_models_of_netlogo_take_steps(name, steps):
    with pytest.importorskip("minerva_fast").interpreted():
        figures = library.figures(name, 1, steps)
    assert {key: round(number, 2) for key, number in figures.items()} == FIGURES[name]


@pytest.mark.parametrize("room", [0.5, 4.0, 4.6, 30.0, 200.0])
def test_vehicles_stop_within_the_room_ahead(room):
    braking, slow = 4.5, 6.0
    speeds = [vehicles.stopping(room, braking)]
    while speeds[-1] > 0:
        speeds.append(max(speeds[-1] - braking, 0.0))
    assert room - 0.01 < sum(speeds) <= room
    speed, driven = float(vehicles.slowing(room, slow, braking)), 0.0
    assert speed >= slow
    while speed > slow:
        driven, speed = driven + speed, max(speed - braking, slow)
    assert driven <= room


def test_vehicles_follow_each_other_and_give_way():
    way = vehicles.Way(("in", ":c_0", "out"), np.array([0.0, 60.0, 70.0]), (14.0, 8.0, 14.0))
    major = vehicles.Way(("north", ":c_1", "south"), np.array([0.0, 60.0, 74.0]), (14.0,) * 3)
    columns = {
        "ids": ["first", "second", "other"], "x": np.array([30.0, 10.0, 20.0]), "speed": np.full(3, 10.0),
        "goal": np.full(3, 170.0), "departs": np.zeros(3), "length": 5.0, "dawdling": 0.0,
    }  # fmt: skip
    ways = {"first": way, "second": way, "other": major}
    world = vehicles.world(columns, ways, {":c_0": [":c_1"]})
    with world.start(seed=1) as live:
        rows = [live.agents(vehicles.Vehicle)]
        while not (rows[-1]["arrives"] > 0).all():
            live.step(vehicles.STEP)
            rows.append(live.agents(vehicles.Vehicle))
    first, second, other = np.array([row["x"] for row in rows]).T
    together = (first > 60) & (first < 75) & (other > 60) & (other < 79)
    assert not together.any()
    assert ((first - second)[second < 170] >= 5.0).all()
    assert rows[-1]["arrives"].argmax() == 1
