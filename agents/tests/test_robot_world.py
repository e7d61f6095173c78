"""The initial string of 4.2.4, its options, and the errors of invalid options."""

import json
import math
from pathlib import Path

import floor_plans
import numpy as np
import pytest

from minerva_agents.robot import maps
from minerva_agents.robot.errands import AParcel
from minerva_agents.robot.grid import MapError, clearance
from minerva_agents.robot.maps import load_map, spread
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.world import defaults, notes, scene, vocabulary
from minerva_bus import EMPTY, MinervaError
from minerva_bus.grammar.scene import agents


@pytest.fixture
def hall(tmp_path):
    """A map of a hall of 6 m x 4 m, turned by 30 degrees, without start and markers."""
    return floor_plans.hall(tmp_path, origin=[2.0, -1.0, math.radians(30)])


def robots(string):
    return [ARobot.thaw(node) for node in agents(string) if node.symbol == "ARobot"]


def parcels(string):
    return [AParcel.thaw(node) for node in agents(string) if node.symbol == "AParcel"]


def places(string):
    return [robot.metres(robot.position) for robot in robots(string)]


def test_the_initial_string_is_that_of_the_paper():
    string = scene({})
    assert [node.symbol for node in string] == [
        "PMap", *["TPlace"] * 8, "ARobot", *["AParcel"] * 8,
    ]  # fmt: skip
    (robot,) = robots(string)
    assert not robot.grid.any()
    assert (robot.speed, robot.objective, robot.action) == (0.0, "", EMPTY)
    assert places(string) == [pytest.approx((1.4, 1.3))]
    assert robot.angle == 90.0


def test_it_is_a_string_of_the_vocabulary():
    string = scene({"robots": 2})
    assert vocabulary.check(string) == string
    assert vocabulary.read(str(string)) == string


def test_the_kind_responds_to_the_papers_events():
    papers = {"eLaser", "eCamera", "eDecide", "eObjective", "eSpeed"}
    assert ARobot.kind.subscribes == papers | {
        "eClear", "eCollision", "eErrand", "eInterrupt", "eRefused", "eTake", "eTaken",
    }  # fmt: skip
    assert ARobot.kind.views == {"eRepresent", "ePicture"}
    names = ARobot.kind.fields.names
    assert names[:7] == ("grid", "row", "column", "angle", "speed", "objective", "action")


def test_the_grid_lies_under_all_of_a_turned_map(hall):
    string = scene({"map": hall})
    (robot,) = robots(string)
    turn = math.radians(30)
    for along, across in ((0, 0), (6, 0), (0, 4), (6, 4)):
        x = 2 + along * math.cos(turn) - across * math.sin(turn)
        y = -1 + along * math.sin(turn) + across * math.cos(turn)
        row, column = (x - robot.x0) / robot.cell, (y - robot.y0) / robot.cell
        assert 0.9 < row < robot.grid.shape[0] - 0.9
        assert 0.9 < column < robot.grid.shape[1] - 0.9


def test_a_map_without_markers_gets_some(hall):
    assert [node.symbol for node in scene({"map": hall})].count("TPlace") == 6
    assert defaults({"map": hall})["objective"] in "ABCDEF"


def test_markers_may_be_given(hall):
    string = scene({"map": hall, "markers": {"desk": [3.0, 1.0]}})
    assert 'TPlace<x=3, y=1, angle=0>(PMarker<name="desk">)' in str(string)
    assert robots(string)[0].markers == ("desk",)


def test_robots_start_side_by_side():
    string = scene({"robots": 5})
    assert [robot.id for robot in robots(string)] == ["r1", "r2", "r3", "r4", "r5"]
    starts = places(string)
    gaps = [math.dist(first, other) for first in starts for other in starts if first is not other]
    assert min(gaps) >= 3 * 0.18
    assert max(gaps) < 3


def test_the_start_may_be_given():
    string = scene({"start": "7, 2.9, -45"})
    assert places(string) == [pytest.approx((7, 2.9))]
    assert robots(string)[0].angle == -45.0


def test_there_is_a_parcel_at_every_marker():
    string = scene({})
    placed = parcels(string)
    assert [parcel.id for parcel in placed] == [f"p{number}" for number in range(1, 9)]
    assert [parcel.marker for parcel in placed] == list(robots(string)[0].markers)
    assert len({parcel.side for parcel in placed}) == 8
    kitchen = next(parcel for parcel in placed if parcel.marker == "kitchen")
    assert math.dist((kitchen.x, kitchen.y), (15.6, 10.2)) < 0.3
    assert (kitchen.y, kitchen.carrier) == (min(kitchen.y, 10.2), "")


def test_positions_of_parcels_are_options():
    placed = parcels(scene({"parcels": "office, store,office"}))
    assert [parcel.marker for parcel in placed] == ["office", "store", "office"]
    assert math.dist((placed[0].x, placed[0].y), (placed[2].x, placed[2].y)) > 0.05
    assert parcels(scene({"parcels": ""})) == []


def test_options_reach_the_robot():
    given = {"cell": 0.2, "radius": 0.25, "planner": "random", "fov": 90, "sight": 3}
    (robot,) = robots(scene(given))
    assert {name: getattr(robot, name) for name in given} == given


def test_defaults_complete_the_options():
    done = defaults({"speed": 0.8, "robots": 2})
    assert (done["objective"], done["speed"], done["robots"]) == ("kitchen", 0.8, 2)
    assert (done["planner"], done["map"]) == ("astar", "")
    assert defaults({"objective": "lab"})["objective"] == "lab"


def test_without_a_kitchen_the_objective_is_the_farthest(hall):
    markers = {"near": [4.0, 1.6], "far": [2.0, 0.5]}
    assert defaults({"map": hall, "markers": markers})["objective"] == "far"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"planner": "A*"}, "planner: expected 'astar' or 'random'"),
        ({"planner": "astra"}, "did you mean 'astar'"),
        ({"objective": "kichen"}, "unknown marker 'kichen'; did you mean 'kitchen'"),
        ({"parcels": "ofice"}, "parcels: unknown marker 'ofice'; did you mean 'office'"),
        ({"parcels": 3}, "parcels: expected a string, not 3"),
        ({"robots": 0}, "robots: expected an integer >= 1, not 0"),
        ({"robots": 2.5}, "robots: expected an integer"),
        ({"robots": 2000, "radius": 0.4}, r"room for \d+ robots .* of 2000 requested"),
        ({"cell": 0}, "cell: expected a number above 0"),
        ({"cell": "wide"}, "cell: expected a number above 0, not 'wide'"),
        ({"radius": -1.0}, "radius: expected a number above 0"),
        ({"start": "here"}, "start: expected 'x, y, degrees', not 'here'"),
        ({"start": "0.1, 0.1"}, r"does not fit at \(0.1, 0.1\)"),
        ({"start": "99, 0"}, "does not fit"),
        ({"markers": {"desk": [99, 0]}}, "markers: desk at .* is not on the map"),
        ({"markers": {"desk": [1]}}, r"markers.desk: expected a position \[x, y\]"),
        ({"markers": [1]}, "markers: expected names with positions"),
        ({"map": "nowhere.yaml"}, "nowhere.yaml: not a file"),
        ({"map": 3}, "map: expected a string"),
    ],
)
def test_errors_are_reported(options, says):
    with pytest.raises(MinervaError, match=says):
        scene(defaults(options))


@pytest.mark.parametrize("resolution", [100.0, 1000.0, 1e9, 1e300])
def test_a_map_too_large_for_a_robot_s_grid_is_refused_before_there_is_one(hall, resolution):
    path = Path(hall)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"resolution": resolution}))
    with pytest.raises(MapError, match=r"needs more than .* cells of 0\.1 m"):
        scene({"map": hall})


def test_cells_too_small_for_a_map_are_refused_before_there_are_any():
    with pytest.raises(MapError, match="needs more than 32000000 cells of 1e-05 m"):
        scene({"cell": 1e-5})


def test_a_map_error_is_one_of_ours():
    assert issubclass(MapError, MinervaError)
    assert issubclass(MapError, ValueError)


def test_the_clearance_of_a_map_is_computed_once(hall, monkeypatch):
    computed = []

    def counted(obstacles):
        computed.append(obstacles.shape)
        return clearance(obstacles)

    monkeypatch.setattr(maps, "clearance", counted)
    scene(defaults({"map": hall, "robots": 3}))
    assert len(computed) == 1


@pytest.mark.parametrize("speed", [-1, -0.5, "fast"])
def test_a_speed_below_zero_is_refused_before_anything_runs(speed):
    with pytest.raises(MinervaError, match="option speed: expected a number >= 0, not"):
        defaults({"speed": speed})


def test_a_changed_map_is_read_again(hall):
    before = scene(defaults({"map": hall}))
    image = Path(hall).with_suffix(".pgm")
    pixels = bytearray(image.read_bytes())
    pixels[-60 * 20 - 30] = 0
    image.write_bytes(pixels)
    assert scene(defaults({"map": hall})) != before


def test_as_many_markers_as_there_is_room_for(tmp_path):
    image = np.zeros((14, 30), np.uint8)
    image[2:-2, 2:-2] = 254
    (tmp_path / "small.pgm").write_bytes(b"P5\n30 14\n255\n" + image.tobytes())
    (robot,) = robots(scene({"map": str(tmp_path / "small.pgm")}))
    assert 0 < len(robot.markers) < 6
    with pytest.raises(MapError, match=f"room for {len(robot.markers)} places"):
        spread(load_map(tmp_path / "small.pgm"), 6, 0.18, (0.75, 0.35, 0.0))


@pytest.mark.parametrize(
    ("place", "is_hidden"),
    [
        ((0.05, 0.5), True),  # in the wall of 0.1 m around the hall
        ((0.097, 0.5), True),
        ((0.0995, 0.5), False),  # on its surface, as a sign hangs on a wall
        ((0.2, 0.5), False),
    ],
)
def test_a_run_warns_of_markers_inside_obstacles(hall, place, is_hidden):
    along, across = place
    cos, sin = math.cos(math.radians(30)), math.sin(math.radians(30))
    sign = [2.0 + cos * along - sin * across, -1.0 + sin * along + cos * across]
    lines = notes({"map": hall, "markers": {"sign": sign, "table": [3.0, 1.0]}})
    assert ["no robot can find sign:" in line for line in lines] == [True] * is_hidden
