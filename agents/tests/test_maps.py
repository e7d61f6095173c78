"""Maps: meaning of map_server files, rejected files and reasons, places, the office plan."""

import importlib.util
import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import minerva_agents.robot.maps as maps
from minerva_agents.robot.grid import MapError, clearance, inflate
from minerva_agents.robot.maps import (
    Marker,
    OccupancyMap,
    free_component,
    load_map,
    roomiest,
    spread,
)
from minerva_agents.robot.planning import shortest_path
from tests.counting import calls

REPOSITORY = Path(__file__).parents[2]
ROS_MAPS = REPOSITORY.parent / "shared" / "data" / "ros_maps"
OFFICE = Path(maps.__file__).parent / "plan" / "office.yaml"
KEYS = {
    "image": "m.pgm",
    "resolution": 0.5,
    "origin": [0.0, 0.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
# Top row: occupied, unknown, free; bottom row: free, free, occupied.
SMALL = b"P5\n3 2\n255\n" + bytes([0, 205, 254, 254, 254, 0])


@pytest.fixture
def write(tmp_path):
    """Write m.pgm and m.yaml with changed keys (None removes one); return the YAML path."""

    def writer(picture=SMALL, **changes):
        keys = {key: value for key, value in (KEYS | changes).items() if value is not None}
        (tmp_path / "m.pgm").write_bytes(picture)
        (tmp_path / "m.yaml").write_text(json.dumps(keys))
        return tmp_path / "m.yaml"

    return writer


def rows(floor):
    """The cells in the order of the image: the top row first."""
    return floor.cells.T[::-1].tolist()


def floor_of(*lines, resolution=0.1):
    """A map from a drawing: # is occupied, ? unknown, the top row first."""
    values = {".": 0, "#": 100, "?": -1}
    drawn = np.array([[values[mark] for mark in line] for line in lines], np.int16)
    return OccupancyMap(np.ascontiguousarray(drawn[::-1].T), resolution)


# --- meaning of the keys ------------------------------------------------------------------------


def test_columns_are_x_and_rows_from_below_are_y(write):
    floor = load_map(write())
    assert floor.cells.tolist() == [[0, 100], [0, -1], [100, 0]]
    assert floor.cells.dtype == np.int16
    assert not floor.cells.flags.writeable
    assert floor.resolution == 0.5
    assert floor.obstacles.tolist() == [[False, True], [False, True], [True, False]]


def test_origin_turns_and_shifts_the_map(write):
    floor = load_map(write(origin=[1.0, 2.0, math.pi / 2]))
    assert (floor.x, floor.y, floor.angle) == (1.0, 2.0, pytest.approx(90.0))
    assert floor.centre_of((2, 0)) == pytest.approx((0.75, 3.25))
    assert floor.cell_at(0.75, 3.25) == (2, 0)
    assert floor.holds(0.75, 3.25)
    assert not floor.holds(1.25, 2.25)


@given(st.floats(-math.pi, math.pi), st.floats(-50, 50), st.integers(-5, 50), st.integers(-5, 50))
def test_a_cell_holds_its_own_centre(angle, x, row, column):
    floor = OccupancyMap(np.zeros((4, 4), np.int16), 0.05, x, -x, math.degrees(angle))
    assert floor.cell_at(*floor.centre_of((row, column))) == (row, column)


def test_markers_and_start(write):
    floor = load_map(write(markers={"desk": [0.25, 0.25], "door": [1, 0.3]}, start=[0.2, 0.4, 90]))
    assert floor.markers == (Marker("desk", 0.25, 0.25), Marker("door", 1.0, 0.3))
    assert floor.start == (0.2, 0.4, 90.0)
    assert load_map(write()).markers == ()
    assert load_map(write()).start is None


def test_negate_swaps_black_and_white(write):
    assert rows(load_map(write(negate=1))) == [[0, 100, 100], [100, 100, 0]]
    assert rows(load_map(write(negate=True))) == [[0, 100, 100], [100, 100, 0]]


def test_the_thresholds_themselves_are_unknown(write):
    image = b"P2 4 1 100  34 35 36 80"
    floor = load_map(write(image, occupied_thresh=0.65, free_thresh=0.2))
    assert rows(floor) == [[100, -1, -1, -1]]
    assert rows(load_map(write(b"P2 2 1 100 80 81", free_thresh=0.2))) == [[-1, 0]]


def test_scale_has_three_values_too(write):
    assert rows(load_map(write(mode="scale"))) == [[100, -1, 0], [0, 0, 100]]


def test_raw_holds_percentages(write):
    floor = load_map(write(b"P2 6 1 255 0 19 50 66 100 101", mode="raw"))
    assert rows(floor) == [[0, 0, -1, 100, 100, -1]]


def test_unknown_keys_are_passed_over(write):
    assert rows(load_map(write(author="somebody", cost=[1, 2]))) == rows(load_map(write()))


def test_an_image_alone_has_the_usual_values(write):
    floor = load_map(write().with_name("m.pgm"))
    assert rows(floor) == [[100, -1, 0], [0, 0, 100]]
    assert (floor.resolution, floor.x, floor.y, floor.angle) == (0.05, 0.0, 0.0, 0.0)


def test_the_image_may_be_elsewhere(write, tmp_path):
    write()
    elsewhere = tmp_path / "images"
    elsewhere.mkdir()
    (elsewhere / "far.pgm").write_bytes(SMALL)
    for name in ("images/far.pgm", "../" + tmp_path.name + "/m.pgm", str(elsewhere / "far.pgm")):
        (tmp_path / "far.yaml").write_text(json.dumps(KEYS | {"image": name}))
        assert rows(load_map(tmp_path / "far.yaml")) == [[100, -1, 0], [0, 0, 100]]


# --- YAML ---------------------------------------------------------------------------------------

YAML = """\
# made by map_saver
image: m.pgm
resolution: 5e-2
origin: [-1.5, 2, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
markers: {kitchen: [-1.49, 2.01]}
"""


def test_yaml_that_is_not_json(write):
    path = write()
    path.write_text(YAML)
    floor = load_map(path)
    assert (floor.resolution, floor.x, floor.y) == (0.05, -1.5, 2.0)
    assert floor.markers == (Marker("kitchen", -1.49, 2.01),)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: &x [1]\nb: *x", "anchors and aliases"),
        ("a: &x 1", "anchors and aliases"),
        ("a: [", "not YAML"),
        ("a: !!python/object/apply:os.getcwd []", "not YAML"),
        ("a: !!int ''", "not YAML"),
        ("a: !!timestamp b", "not YAML"),
        ("a: 2001-99-99", "month"),
        ("? [a]\n: 1", "not YAML"),
        ("[" * 50_000, "not YAML|nested"),
        ("- 1", "contains list; expected keys"),
        ("markers: {A: [1, 1], B: [2, 2], A: [4, 4]}", "key A is there 2 times; rename"),
        ("a: 1\nb: 2\na: 3\na: 4", "key a is there 3 times"),
        ('{"markers": {"A": [1, 1], "A": [4, 4]}}', "key A is there 2 times"),
        ("", "contains NoneType"),
        ("[1]", "contains list"),
        ("a: b\n--- \nc: d", "not YAML"),
    ],
)
def test_strange_yaml_is_refused(write, text, says):
    path = write()
    path.write_text(text)
    with pytest.raises(MapError, match=says) as caught:
        load_map(path)
    assert "m.yaml" in str(caught.value)


def test_yaml_of_other_sizes_and_encodings_is_refused(write):
    path = write()
    path.write_bytes(b"#" * 1_000_001)
    with pytest.raises(MapError, match="has 1000001 bytes; expected at most 1000000"):
        load_map(path)
    path.write_bytes(b"image: \xff")
    with pytest.raises(MapError, match="byte 7 is not UTF-8"):
        load_map(path)


@pytest.mark.parametrize("key", sorted(KEYS))
def test_a_missing_key_is_named(write, key):
    with pytest.raises(MapError, match=rf"m\.yaml: key {key} is missing; add it"):
        load_map(write(**{key: None}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("resolution", value) for value in (0, -0.05, math.nan, math.inf, "wide", [1], True, {})),
        *(("origin", value) for value in ([0, 0], [0, 0, 0, 0], [0, 0, "x"], 3, [0, math.inf, 0])),
        *(("negate", value) for value in (2, "maybe", [0])),
        *(("occupied_thresh", value) for value in (1.5, 0.1, "much", math.nan)),
        *(("free_thresh", value) for value in (-0.1, 0.7, [0.1])),
        *(("mode", value) for value in ("colour", 3, ["raw"])),
        *(("markers", value) for value in ([1, 2], "desk", {"": [0, 0]})),
        *(
            ("markers", {"a": value})
            for value in ([1], [1, 2, 3], "b", [9, 9], [math.nan, 0], [1e308, 1])
        ),
        *(("start", value) for value in ([0.1, 0.1], [9, 9, 0], "here", [0.1, 0.1, math.inf])),
    ],
)
def test_an_ill_typed_key_is_named(write, key, value):
    with pytest.raises(MapError, match=rf"m\.yaml: .*{key}.* is .*; expected ."):
        load_map(write(**{key: value}))


def test_a_marker_needs_a_name_of_text(write):
    path = write()
    path.write_text(YAML.replace("kitchen", "yes"))
    with pytest.raises(MapError, match="put it in quotes"):
        load_map(path)


def test_a_name_that_is_no_file_is_refused(write, tmp_path):
    for path in (tmp_path, tmp_path / "none.yaml", tmp_path / "none.pgm"):
        with pytest.raises(MapError, match="not a file; expected a map"):
            load_map(path)
    path = write()
    for name in ("none.pgm", ".", "a" * 5000 + ".pgm", "/dev/null"):
        path.write_text(json.dumps(KEYS | {"image": name}))
        with pytest.raises(MapError, match=r"not a file|cannot read"):
            load_map(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.pgm")
    with pytest.raises(MapError, match="not a file"):
        load_map(tmp_path / "pipe.pgm")


@pytest.mark.parametrize("missing", ["yaml", "PIL"])
def test_a_missing_library_is_named_with_its_remedy(write, tmp_path, monkeypatch, missing):
    path = write()
    path.write_text(YAML)
    (tmp_path / "m.png").write_bytes(b"\x89PNG")
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(MapError, match=r"pip install 'minerva-bus\[maps\]'"):
        load_map(path if missing == "yaml" else tmp_path / "m.png")


# --- images -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "image",
    [
        SMALL,
        b"P2\n# by hand\n3 2 # size\n255\n0 205 254\n254 254 0\n",
        b"P2 3 2 255 0 205 # more\n254 254 254 0",
        b"P5\r\n# a comment\r\n3\t2\r\n# another\r\n255\n" + SMALL[-6:],
        b"P5 3 2 65535 " + np.array([0, 52685, 65278, 65278, 65278, 0], ">u2").tobytes(),
        b"P5 3 2 1020 " + np.array([0, 820, 1016, 1016, 1016, 0], ">u2").tobytes(),
        b"P2 3 2 51 0 41 51 51 51 0",
        SMALL + b"\n",
    ],
)
def test_pgm_of_every_kind(write, image):
    assert rows(load_map(write(image))) == [[100, -1, 0], [0, 0, 100]]


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (b"", "starts with b''; expected P2 or P5"),
        (b"P6\n1 1\n255\n000", "starts with b'P6'"),
        (b"P5", "width is invalid: b'' at byte 2"),
        (b"P53 2 255 abcdef", "width is invalid"),
        (b"P5\n3 x\n255\nabcdef", "height is invalid: b' x"),
        (b"P5\n-3 2\n255\nabcdef", "width is invalid"),
        (b"P5\n3 2\n# 255\nabcdef", "maxval is invalid"),
        (b"P5\n3 2\n0\nabcdef", "maxval is 0; expected 1 to 65535"),
        (b"P5\n3 2\n65536\nabcdef", "maxval is 65536"),
        (b"P5\n3 2\n255", "maxval is followed by b''"),
        (b"P5\n0 2\n255\n", "is 0 x 2; expected 1 to 100000000 pixels"),
        (b"P5\n100000 1001\n255\n", "is 100000 x 1001; expected"),
        (b"P5\n99999999999 1\n255\n", "width is invalid"),
        (SMALL[:-1], "5 bytes follow the header; expected 6"),
        (SMALL + b"x", "7 bytes follow the header; expected 6"),
        (b"P5\n3 2\n65535\nabcdef", "6 bytes follow the header; expected 12"),
        (b"P5\n3 2\n100\nabcdef", "a pixel is 102; expected at most maxval, 100"),
        (b"P2\n3 2\n9\n1 2 3 4 5", "5 numbers follow the header; expected 6"),
        (b"P2\n3 2\n9\n1 2 3 4 5 6 7", "7 numbers follow the header; expected 6"),
        (b"P2\n3 2\n9\n1 2 3 4 5 x", "invalid pixel b'x'"),
        (b"P2\n3 2\n9\n1 2 3 4 5 -6", "invalid pixel b'-6'"),
        (b"P2\n3 2\n9\n1 2 3 4 5 " + b"6" * 5000, "invalid pixel b'666"),
        (b"P2\n3 2\n9\n1 2 3 4 5 10", "a pixel is 10; expected at most maxval, 9"),
    ],
)
def test_pgm_that_is_damaged_is_refused(write, image, says):
    with pytest.raises(MapError) as caught:
        load_map(write(image))
    assert says in str(caught.value)
    assert "m.pgm: " in str(caught.value)


@settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.one_of(
        st.binary(max_size=60),
        st.builds(
            lambda magic, head, body: magic + head + body,
            st.sampled_from([b"P2", b"P5"]),
            st.text("0123 \n#x", max_size=24).map(str.encode),
            st.binary(max_size=40),
        ),
        st.builds(
            lambda at, byte: SMALL[:at] + byte + SMALL[at + 1 :],
            st.integers(0, len(SMALL) - 1),
            st.binary(max_size=3),
        ),
    )
)
def test_any_bytes_are_a_map_or_a_map_error(tmp_path, data):
    (tmp_path / "any.pgm").write_bytes(data)
    try:
        floor = load_map(tmp_path / "any.pgm")
    except MapError:
        return
    assert floor.cells.size
    assert set(np.unique(floor.cells)) <= {0, 100, -1}


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 65535), st.randoms(), st.booleans())
def test_a_pgm_survives_a_round_trip(tmp_path, width, height, most, random, plain):
    levels = [[random.randint(0, most) for _ in range(width)] for _ in range(height)]
    flat = [level for row in levels for level in row]
    kind = np.uint8 if most < 256 else ">u2"
    body = " ".join(map(str, flat)).encode() if plain else np.array(flat, kind).tobytes()
    header = f"{'P2' if plain else 'P5'} {width} {height} {most}\n".encode()
    (tmp_path / "any.pgm").write_bytes(header + body)

    def value(level):
        p = (most - level) / most
        return 100 if p > 0.65 else 0 if p < 0.196 else -1

    loaded = load_map(tmp_path / "any.pgm")
    assert rows(loaded) == [[value(level) for level in row] for row in levels]


def picture(mode, pixels, path):
    image_module = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    image = image_module.fromarray(np.array(pixels, mode))
    image.save(path)
    return path


def test_png_in_grey_and_in_16_bits(tmp_path):
    grey = [[0, 205, 254], [254, 254, 0]]
    for kind, factor in ((np.uint8, 1), (np.uint16, 257)):
        path = picture(kind, np.array(grey) * factor, tmp_path / f"{factor}.png")
        assert rows(load_map(path)) == [[100, -1, 0], [0, 0, 100]]


def test_a_grey_that_a_png_declares_transparent_is_unknown(tmp_path):
    image = pytest.importorskip("PIL.Image").fromarray(np.array([[0, 254, 255]], np.uint8))
    image.save(tmp_path / "grey.png", transparency=254)
    assert rows(load_map(tmp_path / "grey.png")) == [[100, -1, 0]]


def test_png_in_colour_takes_the_mean_and_transparent_is_unknown(tmp_path):
    colours = [[[0, 0, 0, 255], [255, 255, 255, 255], [255, 255, 255, 0], [255, 0, 0, 255]]]
    path = picture(np.uint8, colours, tmp_path / "colour.png")
    assert rows(load_map(path)) == [[100, 0, -1, 100]]


def test_bmp(tmp_path):
    path = picture(np.uint8, [[0, 255]], tmp_path / "m.bmp")
    assert rows(load_map(path)) == [[100, 0]]


def test_damaged_images_are_refused(tmp_path):
    whole = picture(np.uint8, np.arange(4096).reshape(64, 64) % 251, tmp_path / "w.png")
    data = whole.read_bytes()
    for number, damaged in enumerate([b"", b"text", data[:40], data[: len(data) // 2]]):
        path = tmp_path / f"{number}.png"
        path.write_bytes(damaged)
        with pytest.raises(MapError, match=r"\d\.png: not a readable image"):
            load_map(path)


# --- maps from other sources --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shape", "origin", "free"),
    [
        ("depot.yaml", (604, 307), (0.0, 0.0), 179481),
        ("turtlebot3/map.yaml", (384, 384), (-10.0, -10.0), 7939),
    ],
)
def test_maps_of_ros(name, shape, origin, free):
    if not (ROS_MAPS / name).exists():
        pytest.skip(f"no map {name} in {ROS_MAPS}")
    pytest.importorskip("yaml", reason="PyYAML is not installed")
    floor = load_map(ROS_MAPS / name)
    assert floor.cells.shape == shape
    assert (floor.x, floor.y) == origin
    assert np.count_nonzero(floor.cells == 0) == free
    start = roomiest(floor, 0.2)
    check_spread(floor, spread(floor, 6, 0.2, start), start, 0.2)


# --- placing ------------------------------------------------------------------------------------

TWO_ROOMS = floor_of(
    "############",
    "#....#.....#",
    "#....#.....#",
    "#....#.....#",
    "#....#..?..#",
    "############",
)


def check_spread(floor, markers, start, radius):
    blocked = inflate(floor.obstacles, radius / floor.resolution)
    for marker in markers:
        assert shortest_path(blocked, floor.cell_at(*start[:2]), floor.cell_at(marker.x, marker.y))
    places = [start[:2], *((marker.x, marker.y) for marker in markers)]
    near = min(math.dist(a, b) for n, a in enumerate(places) for b in places[:n])
    assert near > 2 * radius


def test_the_largest_component_and_the_one_at_a_point():
    assert np.count_nonzero(free_component(TWO_ROOMS, 0.05)) == 19
    assert np.count_nonzero(free_component(TWO_ROOMS, 0.05, (0.25, 0.25))) == 16
    assert np.count_nonzero(free_component(TWO_ROOMS, 0.1, (0.25, 0.25))) == 4


def test_a_corner_does_not_join_components():
    assert np.count_nonzero(free_component(floor_of("..#", "##.", "##."), 0.05)) == 2


def test_the_edge_of_the_map_is_a_wall():
    assert np.count_nonzero(free_component(floor_of("...", "...", "..."), 0.1)) == 1


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 6))
@settings(max_examples=30, deadline=None)
def test_components_are_what_paths_join(seed, wide, high):
    cells = np.where(np.random.default_rng(seed).random((wide, high)) < 0.4, 100, 0)
    floor = OccupancyMap(cells.astype(np.int16), 1.0)
    for at in np.argwhere(cells == 0)[:3]:
        start = (int(at[0]), int(at[1]))
        component = free_component(floor, 0.5, floor.centre_of(start))
        for row, column in np.ndindex(cells.shape):
            joined = shortest_path(floor.obstacles, start, (row, column)) is not None
            assert component[row, column] == joined


def test_a_lack_of_space_is_reported():
    with pytest.raises(MapError, match=r"radius 5 m fits nowhere on the map of 12 x 6 cells"):
        free_component(TWO_ROOMS, 5)
    for at in ((0.05, 0.05), (-1.0, 0.0), (0.85, 0.15)):
        with pytest.raises(MapError, match="does not fit at"):
            free_component(TWO_ROOMS, 0.05, at)
    for radius in (0, -1, math.nan, math.inf):
        with pytest.raises(MapError, match="expected metres > 0"):
            free_component(TWO_ROOMS, radius)


def test_roomiest_is_the_middle_and_always_the_same():
    lines = ("#######", "#.....#", "#.....#", "#.....#", "#.....#", "#.....#", "#######")
    assert roomiest(floor_of(*lines), 0.1) == (0.35, 0.35, 0.0)
    assert roomiest(TWO_ROOMS, 0.05, (0.25, 0.25)) == roomiest(TWO_ROOMS, 0.05, (0.15, 0.15))


def test_spread_is_named_far_apart_and_deterministic():
    floor = load_map(OFFICE)
    markers = spread(floor, 30, 0.2, floor.start)
    assert [marker.name for marker in markers[:3]] == ["A", "B", "C"]
    assert [marker.name for marker in markers[24:28]] == ["Y", "Z", "AA", "AB"]
    assert markers == spread(load_map(OFFICE), 30, 0.2, floor.start)
    assert markers[:5] == spread(floor, 5, 0.2, floor.start)
    check_spread(floor, markers, floor.start, 0.2)


def test_spread_reports_when_space_is_full():
    start = roomiest(TWO_ROOMS, 0.05)
    with pytest.raises(MapError, match=r"there is room for \d+ places .* of 100"):
        spread(TWO_ROOMS, 100, 0.05, start)


def places(rows):
    cells = np.zeros((rows, rows // 2), np.int16)
    cells[rows // 6 :: rows // 6, 20:] = 100
    floor = OccupancyMap(cells, 0.05)
    return spread(floor, 8, 0.2, roomiest(floor, 0.2))


def test_the_search_for_places_grows_at_most_with_the_number_of_cells():
    assert calls(lambda: places(400)) < 6 * calls(lambda: places(200))


# --- the plan that is shipped with the robot ----------------------------------------------------


def test_the_office_needs_no_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert load_map(OFFICE).cells.shape == (360, 240)


def test_the_office_is_yaml_as_well():
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    text = OFFICE.read_text(encoding="utf-8")
    assert yaml.safe_load(text) == json.loads(text)


def test_every_marker_of_the_office_is_in_the_open_and_in_reach():
    floor = load_map(OFFICE)
    room = clearance(floor.obstacles) * floor.resolution
    blocked = inflate(floor.obstacles, 0.25 / floor.resolution)
    start = floor.cell_at(*floor.start[:2])
    assert len(floor.markers) == 8
    for marker in floor.markers:
        cell = floor.cell_at(marker.x, marker.y)
        assert room[cell] >= 0.6
        assert shortest_path(blocked, start, cell) is not None


def test_the_kitchen_is_far_and_out_of_sight():
    floor = load_map(OFFICE)
    kitchen = next(marker for marker in floor.markers if marker.name == "kitchen")
    start = floor.cell_at(*floor.start[:2])
    path = shortest_path(floor.obstacles, start, floor.cell_at(kitchen.x, kitchen.y))
    assert path.length * floor.resolution > 15.0
    line = np.linspace(floor.start[:2], (kitchen.x, kitchen.y), 2000)
    assert any(floor.obstacles[floor.cell_at(x, y)] for x, y in line)


def test_the_office_is_what_its_tool_draws():
    tool = REPOSITORY / "tools" / "draw_plan.py"
    if not tool.exists():
        pytest.skip("the tools are not part of this installation")
    spec = importlib.util.spec_from_file_location("draw_plan", tool)
    draw_plan = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(draw_plan)
    assert OFFICE.read_text(encoding="utf-8") == draw_plan.describe()
    assert OFFICE.with_suffix(".pgm").read_bytes().endswith(draw_plan.draw().tobytes())
