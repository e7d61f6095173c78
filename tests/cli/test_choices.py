"""The table [choices] of a world file: all values that an option can have."""

import tomllib

import pytest

from minerva_agents.robot.control import PLANNERS
from minerva_bus.errors import WorldFileError
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from tests.runtime.running import here, write_world

CHOICES = """
[options]
floor = "hall.txt"
doors = 2
[choices]
floor = ["hall.txt", "none"]
doors = [1, 2]
"""


def world(folder, text=CHOICES):
    path = write_world(folder, frames=1)
    path.write_text(path.read_text() + text)
    (folder / "hall.txt").write_text("")
    return path


@pytest.mark.parametrize(("options", "values"), [
    ({}, ("hall.txt", 2)), ({"floor": "none", "doors": "1"}, ("none", 1)),
    ({"floor": "hall.txt"}, ("hall.txt", 2)),
])  # fmt: skip
def test_a_choice_that_names_a_file_is_its_path(tmp_path, monkeypatch, options, values):
    """The file is that beside the world file, as for a default."""
    (tmp_path / "elsewhere").mkdir()
    path = world(tmp_path)
    monkeypatch.chdir(tmp_path / "elsewhere")
    read = read_world_file(path, Overrides(options)).options
    floor, doors = values
    assert read["floor"] == (str(tmp_path / floor) if floor == "hall.txt" else floor)
    assert read["doors"] == doors


@pytest.mark.parametrize(("words", "message"), [
    (["--floor", "hal.txt"], "--floor must be hall.txt or none, not 'hal.txt'; did you mean 'hall.txt'?"),
    (["--doors", "3"], "--doors must be 1 or 2, not '3'"),
    (["--doors", "x"], "--doors must be 1 or 2, not 'x'"),
])  # fmt: skip
def test_another_value_is_an_error_before_the_start(tmp_path, words, message):
    done = here(tmp_path, "run", world(tmp_path), *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"minerva: {message}\n"


@pytest.mark.parametrize(("table", "message"), [
    ('[options]\na = "x"\n[choices]\nb = ["x"]', r"toml:\d+:\d+: choices.b is not an option.*\[options\]"),
    ('[options]\na = "x"\n[choices]\na = "x"', 'choices.a must be a list of values, .*the default, "x"'),
    ('[options]\na = "x"\n[choices]\na = ["y"]', 'choices.a must be a list .*the default, "x"'),
    ('[options]\na = "x"\n[choices]\na = []', 'choices.a must be a list .*the default, "x"'),
])  # fmt: skip
def test_wrong_choices_name_their_line(tmp_path, table, message):
    with pytest.raises(WorldFileError, match=message):
        read_world_file(world(tmp_path, table))
    # The help and completion read the file unchecked.
    assert here(tmp_path, "run", world(tmp_path, table), "--help").returncode == 0


def test_the_help_shows_them(tmp_path):
    shown = " ".join(here(tmp_path, "run", world(tmp_path), "--help").stdout.split())
    assert "--floor <hall.txt|none>" in shown
    assert "--doors <1|2>" in shown


def test_the_planners_of_the_robot_are_its_choices():
    tables = tomllib.loads(find_world("robot").read_text())
    assert sorted(tables["choices"]["planner"]) == sorted([*PLANNERS, "module:function"])
