"""Mistakes of beginners: reports of a few lines with the user's code, and loops that are stopped."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mistakes import HARMLESS, MISTAKES, Mistake

from minerva_bus import Agent, Degrees, EventType, Generator, Metres, World, on, run, service
from minerva_bus.errors import MinervaError
from minerva_bus.grammar import events as batch
from minerva_bus.world.readings import Scan
from minerva_services.sensors.laser import Laser

ERROR, ALL = 10, 25
SERVER = Path(__file__).with_name("command_server.py")


@pytest.fixture(scope="module")
def minerva():
    """Run a command in a fork of a process that has imported everything.

    It takes a folder for the output and the words of the command, and returns exit code and
    output. The process of the tests cannot be forked: other tests may have used Zenoh in it.
    """
    with subprocess.Popen(
        [sys.executable, str(SERVER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:

        def run(folder: Path, *words: object) -> tuple[int, str]:
            output = folder / "output"
            server.stdin.write(json.dumps([str(output), *map(str, words)]) + "\n")
            server.stdin.flush()
            return int(server.stdout.readline()), output.read_text(encoding="utf-8")

        yield run
        server.stdin.close()


def explained(mistake: Mistake, text: str) -> None:
    assert "Traceback" not in text
    for word in mistake.says:
        assert word in text
    if mistake.at:
        assert f"garden.py:{mistake.line}" in text


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_a_mistake_is_explained_in_a_few_lines(mistake, tmp_path, minerva):
    path = mistake.write(tmp_path)
    code, text = minerva(tmp_path, "run", path, "--in-process")
    explained(mistake, text)
    assert len(text.splitlines()) <= ERROR
    assert ("Sun.close" in text) == (mistake.name == "exception in close")
    assert code in (1, 2) or mistake.goes_on
    checked, said = minerva(tmp_path, "check", path)
    if code == 2:  # `check` finds mistakes that prevent a run.
        assert checked == 1
        explained(mistake, said)


@pytest.mark.parametrize("allowed", HARMLESS, ids=lambda allowed: allowed.name)
def test_permitted_actions_log_nothing(allowed, tmp_path, minerva):
    code, text = minerva(tmp_path, "run", allowed.write(tmp_path), "--in-process")
    assert code == 0
    assert "failed" not in text


def test_all_frames_are_shown_to_devices_that_want_them(tmp_path, minerva):
    mistake = next(case for case in MISTAKES if case.name == "exception in an activity")
    code, text = minerva(tmp_path, "run", mistake.write(tmp_path), "--in-process", "--traceback")
    assert code == 1
    assert "Traceback (most recent call last)" in text
    assert "minerva_bus/world/agent_evolution.py" in text
    assert f"garden.py:{mistake.line}" in text


ON_THE_BUS = [
    "exception in an activity",
    "exception in a view",
    "exception in a generator",
    "not a number",
    "calls sys.exit",
    "exception whose text fails",
    "exception that is no Exception",
    "exception with invalid Unicode",
    "keyboard interrupt",
]


@pytest.mark.parametrize("name", ON_THE_BUS)
def test_on_the_bus_it_is_reported_once_and_the_world_stops(name, tmp_path, minerva):
    mistake = next(case for case in MISTAKES if case.name == name)
    code, text = minerva(tmp_path, "run", mistake.write(tmp_path))
    explained(mistake, text)
    assert code == 1
    assert len(text.splitlines()) <= ALL
    assert text.count(f"garden.py:{mistake.line}") == 1
    assert "restart 1 of 5" in text
    assert "restart 2 of 5" not in text
    assert "with the same error in the same frame" in text


def test_on_the_bus_an_error_in_close_is_reported_as_well(tmp_path, minerva):
    mistake = next(case for case in MISTAKES if case.name == "exception in close")
    code, text = minerva(tmp_path, "run", mistake.write(tmp_path))
    explained(mistake, text)
    assert code == 0


def test_the_same_failure_of_several_processes_is_reported_once(tmp_path, minerva):
    mistake = next(case for case in MISTAKES if case.name == "exception in an activity")
    path = mistake.write(tmp_path)
    agents = " · ".join(f"APlant#p{n}" for n in range(8))
    text = path.read_text().replace("APlant#a · APlant#b", agents)
    path.write_text(text.replace("[process.plants]", "[process.plants]\nprocesses = 3"))
    code, text = minerva(tmp_path, "run", path)
    assert code == 1
    assert len(text.splitlines()) <= ALL
    assert text.count(f"garden.py:{mistake.line}") == 1


eLaser = EventType("eLaser", dist=Metres, angle=Degrees)


class Lidar(Generator):
    publishes = ("scan",)

    def __init__(self, robot: str) -> None:
        self.robot = robot

    def generate(self, tick):
        tick.publish("scan", Scan(self.robot, np.ones(3, np.float32), 0.0, 1.0, 8.0, 0.0))


class Car(Agent, symbol="ACar"):
    hits: int = 0

    @on("eLaser")
    def hit(self, laser, moment):
        self.hits += 1


def world(robot):
    services = {"lidar": service(Lidar, robot=robot), "laser": service(Laser)}
    return World("ACar#a", agents=[Car], services=services, symbols=[eLaser], frames=2)


@pytest.mark.parametrize("robot", ["a b", "", "#a", "a\n", "ä", "é" * 10_000])
def test_a_text_that_is_no_id_is_refused_at_the_sensor(robot):
    with pytest.raises(MinervaError) as error:
        run(world(robot))
    text = str(error.value)
    assert "lidar: robot of a Scan on 'scan'" in text
    assert "is not a valid agent id; expected letters" in text
    assert "Lidar.generate" in text
    assert len(text) < 1000


def test_that_of_an_agent_reaches_it():
    assert str(run(world("a")).scene) == "ACar#a<hits=6>()"


eGo = EventType("eGo", speed=float)


class Endless(Generator, events=("eGo",)):
    def generate(self, tick):
        while True:
            yield eGo(1.0)


class Silent(Generator, events=("eGo",)):
    def generate(self, tick):
        while True:
            yield None


class Go(Generator, events=("eGo",)):
    def generate(self, tick):
        return eGo(2.0)


class Echo(Agent, symbol="ACar"):
    @on("eGo")
    def go(self, event, moment):
        pass


class Talker(Echo, symbol="ATalker"):
    @on("eGo")
    def go(self, event, moment):
        while True:
            moment.emit(eGo(1.0))


@pytest.mark.parametrize(
    ("string", "service", "where"),
    [
        ("ACar#a", Endless, "Endless.generate"),
        ("ACar#a", Silent, "Silent.generate"),
        ("ATalker#a", Go, "go"),
    ],
)
def test_a_loop_without_end_stops_with_its_name(string, service, where, monkeypatch):
    monkeypatch.setattr(batch, "MOST_SINGLE", 5_000)
    world = World(string, agents=[Echo, Talker], services=[service], frames=2)
    with pytest.raises(MinervaError) as error:
        run(world)
    assert "makes more than 5,000 events in a frame: end its loop" in str(error.value)
    assert where in str(error.value)


def test_the_limit_is_far_beyond_what_worlds_make():
    assert batch.MOST_SINGLE >= 1_000_000
    batch.check_number(batch.MOST_SINGLE - 1)
