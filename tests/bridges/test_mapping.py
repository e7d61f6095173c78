"""`minerva map` draws the same maps from recordings as the robot itself."""

import math
import re
import sys

import numpy as np
import pytest
from recorded import DEMO, INTEL, Passed, flaser, needs_demo, needs_intel, odom, raw_laser, write

from minerva_agents.robot.map_recording import map_recording
from minerva_agents.robot.mapping import MapChoice, draw, draw_map, save_map, save_picture
from minerva_agents.robot.maps import FREE, OCCUPIED, UNKNOWN, load_map
from minerva_agents.robot.robot import ARobot
from minerva_agents.robot.trajectories import Posed, Unposed, posed_scans
from minerva_agents.robot.vocabulary import eLaser
from minerva_bus import Frame, Tick, Vocabulary, WorldInfo, evolve
from minerva_bus.errors import MinervaError, MisuseError
from minerva_bus.grammar.scene import agents
from minerva_bus.log.recordings import Recorded, RecordingError
from minerva_bus.world.readings import Odometry, Scan, hits
from minerva_services.sensors.carmen import CarmenLog
from minerva_services.sensors.laser import Laser
from minerva_services.sensors.playback import MountOverride

QUARTER = math.pi / 2


def opener(path, **options):
    return lambda: CarmenLog(path, Passed(), **options)


def drawn(path, report=lambda part: None, mounting=None, **choice):
    options = {"mounting": mounting} if mounting else {}
    return draw_map(opener(path, **options), MapChoice(**choice), report)


def code_at(made, x, y):
    return made.map.cells[made.map.cell_at(x, y)]


def events_of(scan):
    """The events that gLaser generates for a scan."""
    laser = Laser()
    laser.joined(WorldInfo("yard", Vocabulary.of(eLaser), 0, 0.1))
    return list(laser.generate(Tick(Frame(0), "laser", readings=(scan,))))


def by_the_robot(made, path, mounting=None):
    """The grid of a robot that receives the events of gLaser at the poses of the log."""
    grid, options = np.zeros_like(made.grid), {"mounting": mounting} if mounting else {}
    posed = posed_scans(CarmenLog(path, Passed(), **options).readings())
    for number, pose in enumerate(posed):
        row, column = (pose.x - made.x) / made.cell, (pose.y - made.y) / made.cell
        robot = ARobot("r1", grid=grid, row=row, column=column, angle=pose.angle, cell=made.cell)
        evolved = evolve(robot.string, events_of(pose.scan), [ARobot], Frame(number))
        (node,) = agents(evolved.scene)
        grid = ARobot.thaw(node).grid
    return grid


def test_a_beam_ends_at_a_wall_and_is_free_before_it(tmp_path):
    """Three beams of 1, 2 and 3 m: right, ahead and left of a robot that faces north."""
    made = drawn(write(tmp_path / "a.log", flaser([1.0, 2.0, 3.0], (0.01, 0.01, QUARTER))))
    for x, y in ((1.01, 0.01), (0.01, 2.01), (-2.99, 0.01)):
        assert code_at(made, x, y) == OCCUPIED
        assert code_at(made, x / 2, y / 2) == FREE
    assert code_at(made, 0.5, 0.5) == UNKNOWN
    assert np.count_nonzero(made.map.cells == OCCUPIED) == 3


def test_a_ray_without_hit_returns_nothing(tmp_path):
    made = drawn(write(tmp_path / "a.log", flaser([81.91, 2.0, 80.0])))
    assert np.count_nonzero(made.map.cells == OCCUPIED) == 1
    assert max(made.grid.shape) * made.cell < 3.0


def test_a_shorter_range_leaves_the_farther_hits_out(tmp_path):
    path = write(tmp_path / "a.log", flaser([1.0, 2.0, 3.0]))
    made = drawn(path, farthest=2.5)
    assert np.count_nonzero(made.map.cells == OCCUPIED) == 2


def test_from_one_second_to_another(tmp_path):
    lines = [flaser([1.0], (x, 0.0, 0.0), time=10.0 + x) for x in range(6)]
    made = drawn(write(tmp_path / "a.log", *lines), begin=1.0, end=3.0)
    assert made.way[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert [*made.notes] == [
        "2 readings skipped: before 1 s (--from)",
        "readings after 3 s are not read (--to)",
    ]


def test_the_grid_is_as_the_robot_draws_it_itself(tmp_path):
    rng = np.random.default_rng(3)
    lines = [
        flaser(rng.uniform(0.2, 3.0, 31).round(3), (*rng.uniform(-2, 2, 2), rng.uniform(-4, 4)))
        for _ in range(12)
    ]
    path = write(tmp_path / "a.log", *lines)
    for mounting in (None, MountOverride(0.2, -0.1, 30.0)):
        made = drawn(path, cell=0.1, mounting=mounting)
        assert np.array_equal(made.grid, by_the_robot(made, path, mounting))
        assert np.count_nonzero(made.grid) > 1000


@pytest.mark.parametrize("mount", [{}, {"mount_angle": 30.0}, {"mount_x": 0.2, "mount_y": -0.1}])
def test_hits_are_those_of_which_gLaser_makes_events(mount):
    ranges = np.array([0.0, 1.0, -1.0, 5.0, math.nan, math.inf, 2.5, 4.99], np.float32)
    scan = Scan("r1", ranges, -40.0, 10.0, 5.0, 0.0, **mount)
    assert [*zip(*hits(scan), strict=True)] == [
        (event.dist, event.angle) for event in events_of(scan)
    ]


# --- poses of the robot ---


def wheels(time, x=0.0, angle=0.0):
    return Recorded(time, "odometry", Odometry("r1", x, 0.0, angle, 0.0, 0.0, time))


def scanned(time):
    return Recorded(time, "scan", Scan("r1", np.ones(1, np.float32), 0.0, 1.0, 8.0, time))


def places(*recorded):
    return [(p.x, p.angle) if isinstance(p, Posed) else None for p in posed_scans(recorded)]


def test_a_scan_is_between_the_odometry_before_and_after():
    poses = places(wheels(1.0, 1.0, 0.0), scanned(1.25), wheels(2.0, 2.0, 40.0))
    assert poses == [pytest.approx((1.25, 10.0))]


def test_it_turns_the_shorter_way():
    (poses,) = places(wheels(1.0, 0.0, 170.0), scanned(1.5), wheels(2.0, 0.0, -170.0))
    assert poses == pytest.approx((0.0, 180.0))


def test_at_an_end_the_nearest_odometry_will_do():
    assert places(scanned(0.5), wheels(1.0, 3.0), wheels(2.0, 4.0), scanned(2.5)) == [
        (3.0, 0.0),
        (4.0, 0.0),
    ]


def test_a_place_without_features_is_unknown():
    assert places(scanned(1.0)) == [None]
    assert places(wheels(1.0), scanned(5.0), wheels(9.0)) == [None]
    assert isinstance(next(posed_scans([scanned(1.0)])), Unposed)


def test_the_scans_own_metadata_take_precedence():
    report = Recorded(1.0, "pose", Odometry("r1", 7.0, 0.0, 5.0, 0.0, 0.0, 1.0))
    assert places(wheels(1.0), report, scanned(1.0), scanned(1.0), wheels(1.0)) == [
        (7.0, 5.0),
        (0.0, 0.0),
    ]


def test_a_raw_laser_is_placed_by_the_wheels(tmp_path):
    lines = [odom(1.0, time=1.0), raw_laser([1.0, 1.0, 1.0], time=1.5), odom(2.0, time=2.0)]
    made = drawn(write(tmp_path / "a.log", *lines))
    assert made.way.tolist() == [[1.5, 0.0]]


def test_scans_without_a_place_are_counted(tmp_path):
    lines = [raw_laser([1.0], time=1.0), odom(time=90.0), raw_laser([1.0], time=90.0)]
    assert drawn(write(tmp_path / "a.log", *lines)).left_out == 1


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        ([odom()], "no scans"),
        ([raw_laser([1.0])], "gives no pose for any of its 1 scans; .*, or --poses matched"),
    ],
)
def test_without_scans_or_places_there_is_no_map(tmp_path, lines, why):
    with pytest.raises(RecordingError, match=why):
        drawn(write(tmp_path / "a.log", *lines))


def test_a_map_that_is_too_large_is_refused(tmp_path):
    path = write(tmp_path / "a.log", flaser([1.0]), flaser([1.0], (1e7, 1e7, 0.0)))
    with pytest.raises(MisuseError, match="Use larger cells"):
        drawn(path)


@pytest.mark.parametrize(
    ("choice", "why"),
    [
        ({"cell": 0.0}, "the cell is 0 m"),
        ({"cell": math.nan}, "the cell is nan m"),
        ({"farthest": -1.0}, "the range is -1 m"),
        ({"begin": 3.0, "end": 2.0}, "from 3 to 2 s there is nothing"),
    ],
)
def test_wrong_choices(choice, why):
    with pytest.raises(MisuseError, match=why):
        MapChoice(**choice)


# --- files ---


@pytest.fixture
def recording(tmp_path):
    lines = [flaser([1.0, 2.0, 1.5], (x / 10, 0.3, x / 5), time=x) for x in range(8)]
    return write(tmp_path / "some.log", *lines)


def test_saved_data_are_read_again(tmp_path, recording):
    made = drawn(recording).map
    again = load_map(save_map(made, tmp_path / "map.pgm"))
    assert np.array_equal(again.cells, made.cells)
    assert set(np.unique(made.cells)) == {FREE, OCCUPIED, UNKNOWN}
    assert (again.resolution, again.angle) == (0.05, 0.0)
    assert (again.x, again.y) == pytest.approx((made.x, made.y))
    assert again.start == pytest.approx((0.0, 0.3, 0.0))


def test_the_files_are_those_of_a_map_server(tmp_path, recording):
    save_map(drawn(recording).map, tmp_path / "map.pgm")
    keys = dict(re.findall(r"(\w+): (.+)", (tmp_path / "map.yaml").read_text()))
    assert {"image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh"} <= {*keys}
    assert keys["image"] == '"map.pgm"'
    magic, _, size, most = (tmp_path / "map.pgm").read_bytes().split(b"\n", 4)[:4]
    shape = drawn(recording).grid.shape
    assert (magic, size, most) == (b"P5", f"{shape[0]} {shape[1]}".encode(), b"255")


def test_north_is_up_in_the_picture(tmp_path):
    pillow = pytest.importorskip("PIL.Image")
    made = drawn(write(tmp_path / "a.log", flaser([2.0, 1.0, 3.0], (0.0, 0.0, 0.0))))
    save_picture(made, tmp_path / "map.png")
    with pillow.open(tmp_path / "map.png") as image:
        pixels = np.asarray(image.convert("L")).astype(int)
    dark = np.argwhere(pixels < 40)
    height = pixels.shape[0]
    # 3 m to the left is north, 2 m to the right south: the origin is below the middle.
    assert dark[:, 0].min() < 0.06 * height
    assert pixels.shape[0] > pixels.shape[1]


@pytest.mark.parametrize(
    ("into", "why"), [("map.png", "ends in .pgm"), ("nowhere/map.pgm", "does not exist")]
)
def test_unwritable_files_are_reported_before_the_work(tmp_path, into, why):
    with pytest.raises(MisuseError, match=why):
        draw(lambda: pytest.fail("opened"), tmp_path / into, MapChoice(), lambda part: None)


def test_without_pillow_there_is_a_map_and_no_picture(tmp_path, recording, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    (*_, said) = draw(opener(recording), tmp_path / "map.pgm", MapChoice(), lambda part: None)
    assert "no picture: " in said
    assert "pip install 'minerva-bus[maps]'" in said
    assert sorted(path.name for path in tmp_path.glob("map.*")) == ["map.pgm", "map.yaml"]


# --- the command ---


def command(file, output=None, cell=0.05, farthest=0.0, begin=0.0, end=None):
    map_recording(file, output, cell, farthest, begin, end)


def test_the_command_creates_three_files_and_lists_them(tmp_path, recording, capsys):
    recording.write_text("FLASER garbage\n" + recording.read_text())
    command(recording, tmp_path / "map.pgm")
    said = capsys.readouterr().err
    assert "line 1 skipped: 'garbage' is not a number of beams (lines passed over: 1)" in said
    assert "map.yaml: " in said
    assert "from 8 scans" in said
    assert sorted(path.name for path in tmp_path.glob("map.*")) == [
        "map.pgm",
        "map.png",
        "map.yaml",
    ]


def test_an_error_of_the_map_says_what_was_skipped(tmp_path):
    path = write(tmp_path / "a.log", odom(), "FLASER 2 1.0 0 0 0 0 0 0 1 h 1")
    with pytest.raises(RecordingError, match=r"no scans .*; .*a.log: line 2 skipped: 2 beams ann"):
        command(path, tmp_path / "map.pgm")


def test_without_a_name_the_map_has_that_of_the_recording(tmp_path, recording, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    command(recording)
    assert (tmp_path / "some.pgm").exists()
    assert "some.png" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("nothing.log", "there is no file .*nothing.log"),
        ("some.txt", "none for 'txt' is installed"),
    ],
)
def test_invalid_recordings(tmp_path, name, why):
    write(tmp_path / "some.txt", odom())
    with pytest.raises(MinervaError, match=why):
        command(tmp_path / name, tmp_path / "map.pgm")


@needs_demo
def test_a_bag_with_scans_only_names_the_missing_topics(tmp_path):
    pytest.importorskip("rosbags")
    with pytest.raises(RecordingError, match="the recording gives no pose for any of its 360"):
        command(DEMO, tmp_path / "map.pgm")


def test_a_bag_becomes_a_map(tmp_path):
    pytest.importorskip("rosbags")
    from recorded import messages, write_bag

    types, store = messages()
    said = [(0.0, "/odom", types.odometry(1.0, 0.0, 0.0, time=100.0))]
    said += [(0.5, "/scan", types.scan([9.0, 2.0, 9.0], time=100.5))]
    said += [(1.0, "/odom", types.odometry(2.0, 0.0, 0.0, time=101.0))]
    command(write_bag(tmp_path / "a.mcap", store, said), tmp_path / "map.pgm")
    made = load_map(tmp_path / "map.yaml")
    assert made.cells[made.cell_at(3.5, 0.0)] == OCCUPIED
    assert made.cells[made.cell_at(2.5, 0.0)] == FREE


# --- a real building ---


@pytest.fixture(scope="module")
def intel():
    parts = []
    return drawn(INTEL, parts.append, cell=0.1), parts


@needs_intel
def test_progress_is_reported(intel):
    _, parts = intel
    assert parts == sorted(parts)
    assert (parts[0] < 0.1, parts[-1]) == (True, 1.0)


@needs_intel
def test_the_building_is_as_large_as_it_is_and_its_walls_are_thin(intel):
    made, _ = intel
    walls, ground = (made.map.cells == code for code in (OCCUPIED, FREE))
    rows, columns = np.nonzero(walls)
    sides = [0.1 * np.subtract(*np.quantile(at, [0.98, 0.02])) for at in (rows, columns)]
    assert all(26 < side < 31 for side in sides)  # the real building is about 28 m square
    assert 350 < 0.01 * ground.sum() < 550
    across = walls[1:-1, 1:-1] & walls[:-2, 1:-1] & walls[2:, 1:-1]
    thick = across & walls[1:-1, :-2] & walls[1:-1, 2:]
    assert thick.sum() < 0.15 * walls.sum()  # a third if walls are three cells thick


@needs_intel
def test_a_recorded_robot_is_on_free_ground(intel):
    made, _ = intel
    known = made.map
    codes = np.array([known.cells[known.cell_at(x, y)] for x, y in made.way.tolist()])
    assert (codes == FREE).mean() > 0.99


@needs_intel
def test_a_part_of_the_log_is_as_the_robot_draws_it_itself(tmp_path):
    import gzip

    with gzip.open(INTEL, "rt") as file:
        lines = [line.rstrip() for line in file if line.startswith("FLASER")][300:320]
    path = write(tmp_path / "part.log", *lines)
    made = drawn(path, cell=0.1)
    assert np.array_equal(made.grid, by_the_robot(made, path))
    assert len(made.way) == 20
