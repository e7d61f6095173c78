"""Doors barely wider than the robot, at any offset from the lines of its grid."""

import math
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from floor_simulator import Simulator

import minerva_agents.robot
from minerva_agents.robot.clearance import Narrows, is_passable, passable_width
from minerva_agents.robot.maps import FREE, OCCUPIED, OccupancyMap
from minerva_agents.robot.world import RobotOptions, notes, scene
from minerva_bus.errors import WorldFileError
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides

ROBOT = Path(minerva_agents.robot.__file__).with_name("robot.toml")

RADIUS, PIXEL = 0.18, 0.005
DEEP, WIDE, WALL = 2.0, 2.4, 0.1


def pixels(metres):
    return round(metres / PIXEL)


def two_rooms(width, offset, along_x):
    """Two rooms with a door between; its first jamb is `offset` metres behind a grid line.

    The face of the wall has the same offset.
    """
    cells = np.full((pixels(2 * DEEP + WALL), pixels(WIDE)), FREE, np.int16)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = OCCUPIED
    face, jamb = pixels(DEEP + offset), pixels(0.9 + offset)
    cells[face : face + pixels(WALL)] = OCCUPIED
    cells[face : face + pixels(WALL), jamb : jamb + pixels(width)] = FREE
    return OccupancyMap(cells if along_x else np.ascontiguousarray(cells.T), PIXEL)


def two_oblique_rooms(width, degrees, shift):
    """A room of 4 x 4 m and a wall through its middle, with a door `shift` m off its centre."""
    count = pixels(4.0)
    x, y = (np.indices((count, count)) + 0.5) * PIXEL - 2.0
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    along, across = x * cos + y * sin - shift, y * cos - x * sin
    solid = (abs(across) < WALL / 2) & (abs(along) > width / 2)
    solid[0] = solid[-1] = solid[:, 0] = solid[:, -1] = True
    start, end = [(2.0 - side * sin, 2.0 + side * cos) for side in (-1.2, 1.2)]
    return OccupancyMap(np.where(solid, OCCUPIED, FREE).astype(np.int16), PIXEL), start, end


def options_of(tmp_path, floor, start, end):
    """Options of a world with this floor and one marker, A."""
    picture = np.where(floor.cells == FREE, 254, 0).astype(np.uint8).T[::-1]
    high, wide = picture.shape
    (tmp_path / "m.pgm").write_bytes(f"P5 {wide} {high} 255\n".encode() + picture.tobytes())
    (tmp_path / "m.yaml").write_text(
        f'{{"image": "m.pgm", "resolution": {PIXEL}, "origin": [0, 0, 0], "negate": 0,'
        ' "occupied_thresh": 0.65, "free_thresh": 0.196}'
    )
    return {
        "map": str(tmp_path / "m.yaml"),
        "start": f"{start[0]}, {start[1]}, 0",
        "markers": {"A": list(end)},
        "parcels": "",
    }


def drive(tmp_path, width, offset, along_x=True, frames=700):
    """Run a search for a marker behind the door; return its results."""
    start, end = (0.7, 0.6), (3.5, 0.6)
    if not along_x:
        start, end = start[::-1], end[::-1]
    options = options_of(tmp_path, two_rooms(width, offset, along_x), start, end)
    return search(options, end, frames)


def search(options, end, frames):
    chosen = RobotOptions.read(options)
    simulator = Simulator(chosen.floor, chosen.places, scene(options), "A")
    run = simulator.go(frames)
    run.reached &= math.dist(simulator.place(), end) < 1.2  # and it has not given up
    return run


@pytest.mark.parametrize("width", [0.54, 0.59])
@pytest.mark.parametrize("offset", [0.005, 0.025, 0.05, 0.075])
def test_it_passes_a_door_wherever_the_lines_of_its_grid_are(tmp_path, width, offset):
    run = drive(tmp_path, width, offset)
    assert run.reached
    assert run.least_gap > RADIUS


@pytest.mark.parametrize(("radius", "cell"), [(0.18, 0.1), (0.18, 0.05), (0.3, 0.1), (0.1, 0.2)])
@pytest.mark.parametrize("into", [0, 1])
def test_there_is_a_way_through_a_door_of_the_passable_width(radius, cell, into):
    """A hit on one jamb may be rounded into the opening, which costs one cell."""
    width = round(passable_width(radius, cell) / cell)
    grid = np.ones((60, 60), np.int16)
    grid[:, 30] = 9
    grid[20 + into : 20 + width, 30] = 1
    narrows = Narrows.around(grid, (10.3, 10.7), radius, cell)
    way = narrows.way_to_cell((10, 50))
    assert not narrows.closed_cells[10, 50]
    assert way is not None
    assert is_passable(grid, [(10.3, 10.7), *way], radius, cell)
    assert gap_of(grid, [(10.3, 10.7), *way]) * cell > radius


def test_there_is_none_through_a_door_that_is_narrower_than_the_robot():
    grid = np.ones((60, 60), np.int16)
    grid[:, 30] = 9
    grid[20:23, 30] = 1
    narrows = Narrows.around(grid, (10.3, 10.7), RADIUS, 0.1)
    assert narrows.way_to_cell((10, 50)) is None
    assert not is_passable(grid, [(21.5, 20.5), (21.5, 40.5)], RADIUS, 0.1)


@pytest.mark.parametrize(
    ("width", "degrees", "shift", "helps"),
    [
        (0.55, 40, 0.0, "--cell 0.05"),
        (0.47, 39, 0.03, "--cell 0.025"),
        (0.3, 39, 0.03, None),  # narrower than the robot
        (0.55, 62, 0.0, None),
        (0.76, 45, 0.05, None),
    ],
)
def test_a_run_warns_of_an_oblique_door_that_the_cells_close(
    tmp_path, width, degrees, shift, helps
):
    """The planner fails on a part of the widths at which the robot fits; the note says where."""
    options = options_of(tmp_path, *two_oblique_rooms(width, degrees, shift))
    lines = list(notes(options))
    assert ["no way to A: with cells of 0.1 m" in line for line in lines] == [True] * bool(helps)
    assert helps is None or lines[0].endswith(helps)


@pytest.mark.parametrize(("degrees", "is_passable"), [(40, False), (62, True)])
def test_the_note_about_an_oblique_door_is_what_happens(tmp_path, degrees, is_passable):
    floor, start, end = two_oblique_rooms(0.55, degrees, 0.0)
    options = options_of(tmp_path, floor, start, end)
    assert bool(notes(options)) is not is_passable
    assert search(options, end, frames=120).reached is is_passable


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({}, None),
        ({"radius": "0.4"}, None),  # no cell size lets such a robot fit through a door of 0.7 m
        (
            {"cell": "0.2"},
            "doors of at least 0.80 m, because their cells are 0.2 m wide; with --cell 0.1",
        ),
        ({"radius": "0.25", "cell": "0.15"}, "doors of at least 0.75 m"),
        ({"cell": "50"}, "because their cells are 50 m wide; with --cell 0.1 the limit is 0.50 m"),
    ],
)
def test_a_run_warns_if_cells_are_too_large_for_doors(options, line):
    notes = read_world_file(ROBOT, Overrides(options=options)).notes
    assert [line in note for note in notes] == ([True] if line else [])


def test_notes_that_are_no_list_are_refused(tmp_path):
    world = ROBOT.read_text().replace("robot.world:notes", "robot.world:defaults")
    (tmp_path / "w.toml").write_text(world)
    with pytest.raises(WorldFileError, match="world:defaults must return a list of texts"):
        read_world_file(tmp_path / "w.toml")


def test_a_run_in_one_process_shows_its_notes():
    words = "run", "robot", "--in-process", "--frames", "1", "--cell", "0.2"
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus.cli.main", *words],
        capture_output=True,
        text=True,
        check=False,  # the robot does not find the kitchen in one frame
    )
    assert "the robots pass doors of at least 0.80 m" in done.stderr + done.stdout


def gap_of(grid, way):
    """The least distance, in cells, between a path and the squares of obstacle cells."""
    low = np.argwhere(grid == 9)
    gaps = []
    for begin, end in pairwise(np.array(way)):
        for part in np.linspace(0.0, 1.0, 200):
            at = begin + part * (end - begin)
            away = np.maximum(np.maximum(low - at, at - low - 1), 0.0)
            gaps.append(np.hypot(*away.T).min())
    return min(gaps)
