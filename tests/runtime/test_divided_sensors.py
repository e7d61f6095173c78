"""Robots whose sensors are several processes: strings of one process, kills, records, errors."""

import os
import shutil
import signal
from pathlib import Path

import pytest
from running import World, alone, eventually, here, minerva, summary

from minerva_bus.errors import WorldFileError
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides

WORLDS = Path(__file__).resolve().parents[2] / "worlds" / "minerva_worlds" / "robots"
DRIFT = ("--robots", 5, "--alpha", 0.01, "--laser_noise", 0.02)
SENSORS = ("physics", "gLaser", "gCamera")


@pytest.fixture
def path(tmp_path):
    shutil.copy(WORLDS / "robots.py", tmp_path)
    return shutil.copy(WORLDS / "robots.toml", tmp_path / f"robots-{os.getpid()}.toml")


def divided(count):
    return [word for name in SENSORS for word in ("--set", f"{name}.processes={count}")]


def recorded(path, count):
    words = ("--record", f"{count}.mcap", "--in-process", "--json", "--frames", 12)
    return summary(here(path.parent, "run", path, *DRIFT, *divided(count), *words))


def test_records_of_any_number_of_processes_are_the_same(path):
    ended = [recorded(path, count) for count in (1, 2, 3)]
    figures = ("digest", "distance_driven", "collisions")
    assert all([each[name] for name in figures] == [ended[0][name] for name in figures]
               for each in ended)  # fmt: skip
    for count in (2, 3):
        assert here(path.parent, "diff", "1.mcap", f"{count}.mcap").returncode == 0
        assert here(path.parent, "replay", f"{count}.mcap", "--recompute").returncode == 0
    resumed = ("run", path, "--resume", "2.mcap", "--frames", 15, "--in-process")
    other = here(path.parent, *resumed, *divided(3))
    assert other.returncode == 2
    assert "gCamera needs as many processes as it had" in other.stderr
    assert here(path.parent, *resumed, *divided(2)).returncode == 0


def test_killed_processes_come_back_with_the_same_string(path):
    names = tuple(f"{name}-{number}" for name in SENSORS for number in (1, 2))
    with World(path, *DRIFT, *divided(2), "--json", "--rate", 20) as world:
        for name in ("physics-2", "gLaser-1"):
            pid = world.runs(*names)[name]
            os.kill(pid, signal.SIGKILL)

            def successor(name=name, pid=pid):
                member = world.members().get(name)
                return member and member["pid"] != pid and member["state"] == "present"

            eventually(successor, f"a successor of {name}")
        world.runs(*names)
        assert minerva(path.parent, "stop", path.stem).returncode == 0
        ended = world.summary()
        world.gone()
    assert ended["digest"] == alone(path, *DRIFT, "--frames", ended["frames"])["digest"]


@pytest.mark.parametrize(("setting", "problem"), [
    ("gDecide.processes=2", "is 2, but Each has one process for all agents; several are possible for"
     " camera, laser, physics"),
    ("gLaser.processes=0", "processes must be at least 1"),
    ('gLaser.processes="two"', "processes must be a whole number"),
    ('gLaser.processes="auto"', '"auto" is for agents; expected a whole number'),
])  # fmt: skip
def test_a_wrong_number_of_processes_is_an_error(path, setting, problem):
    with pytest.raises(WorldFileError) as raised:
        read_world_file(path, Overrides(settings=(setting,)))
    assert problem in str(raised.value)


def test_only_generators_in_step_are_divided(path):
    (path.parent / "free.py").write_text(
        "from minerva_bus import Generator\n"
        "class Free(Generator, events=('eErrand',), when='freely'):\n    by_agent = True\n"
    )
    text = path.read_text().replace('"robots:Dispatcher"', '"free:Free"\nprocesses = 2')
    path.write_text(text)
    with pytest.raises(WorldFileError, match='divide a generator "in step", not "freely"'):
        read_world_file(path)
