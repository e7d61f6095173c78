"""Recorded sensors in worlds: beside simulated ones, in-process, on the bus, when killed."""

import importlib.util
import os
import signal
from pathlib import Path

import numpy as np
import pytest
from recorded import flaser, messages, write, write_bag

from minerva_bus.cli.options import JoinOptions
from minerva_bus.errors import MisuseError
from minerva_bus.frame import stimuli as s
from minerva_bus.frame.algorithm import FrameAlgorithm
from minerva_bus.grammar.events import single
from minerva_bus.grammar.scene import agents
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.runner import InProcessRunner
from minerva_bus.settings.world_settings import Overrides
from minerva_services.bridges.command import bridge_source

TESTS = Path(__file__).parents[1]
FRAMES = 12
REPLAYED = """
[process.log]
service = "carmen"
file = "some.log"
scan = "log_scan"
loop = true
speed = 0.5

[process.gLog]
service = "laser"
topic = "log_scan"
"""


def bus():
    """The module that runs worlds in real processes; a test folder has one of the same name."""
    spec = importlib.util.spec_from_file_location(
        "worlds_on_the_bus", TESTS / "runtime" / "running.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def log_in(folder, scans=40):
    lines = [flaser([1.0 + i / 100, 81.9, 2.0], time=10.0 + i / 50) for i in range(scans)]
    return write(folder / "some.log", *lines)


def world_in(folder, members=REPLAYED, name="replayed"):
    """Write the world `robot` with additional members."""
    log_in(folder)
    path = folder / f"{name}.toml"
    path.write_text(find_world("robot").read_text() + members)
    return path


def lasers_of_each_frame(file, readings=()):
    """The eLaser events of each frame; the i-th reading arrives before frame i."""
    algorithm, frames = FrameAlgorithm(file.world), []

    def told(instruction):
        if isinstance(instruction, s.FrameDone):
            events = instruction.record.events
            frames.append([(e.dist, e.angle) for e in single(events) if e.type == "eLaser"])

    members = {process.name: process.make_member() for process in file.processes}
    runner = InProcessRunner(algorithm, members.values(), told)
    runner.start()
    for number in range(FRAMES):
        if number < len(readings):
            runner.publish(members["log"].published(*readings[number]))
        runner.handle(s.Begin())
    return frames, algorithm.scene


def test_a_simulated_and_a_replayed_laser_run_together(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = read_world_file(world_in(tmp_path), Overrides(frames=FRAMES))
    (log,) = [process.make_member().service for process in file.processes if process.name == "log"]
    recording = log.recording()
    readings = [(x.topic, x.reading) for x in recording.readings() if x.topic == "log_scan"]
    recording.close()
    alone, _ = lasers_of_each_frame(file)
    both, scene = lasers_of_each_frame(file, readings)
    for number in range(FRAMES):
        replayed = [(float(np.float32(1.0 + number / 100)), -90.0), (2.0, 90.0)]
        simulated = [event for event in both[number] if event not in replayed]
        assert len(both[number]) == len(simulated) + len(replayed)
        assert bool(simulated) == bool(alone[number]) == (number > 1)
    robot = next(node for node in agents(scene) if node.id == "r1")
    assert (robot.state["grid"] > 1).any()


def figures_of(asked, name):
    return {member.name: member.figures for member in asked.operator.status().members}.get(name, {})


def state_of(asked, name):
    return {member.name: member.state for member in asked.operator.status().members}.get(name)


def test_a_recording_is_played_on_the_bus_killed_and_played_again(tmp_path):
    worlds = bus()
    path = world_in(tmp_path, name=f"replayed-{os.getpid()}")

    def is_played():
        return figures_of(asked, "log").get("readings", 0) > 10

    with worlds.World(path, "--rate", "20", "--until", "") as world, world.client() as asked:
        pids = world.runs("log", "gLog", "gLaser", "physics")
        worlds.eventually(is_played, "the recording is played")
        assert figures_of(asked, "log")["source"] == "open"
        frame = asked.operator.status().frame
        os.kill(pids["log"], signal.SIGKILL)
        worlds.eventually(
            lambda: world.runs("log")["log"] not in (0, pids["log"]), "it is started again"
        )
        worlds.eventually(is_played, "it is played again")
        worlds.eventually(lambda: asked.operator.status().frame > frame + 5, "the world goes on")


def test_a_recording_is_attached_to_a_running_world_and_ends(tmp_path):
    pytest.importorskip("rosbags")
    worlds, (types, store) = bus(), messages()
    said = [(i / 50, "/base", types.scan([1.0, 2.0, 9.0], time=i / 50)) for i in range(40)]
    bag = write_bag(tmp_path / "some.mcap", store, said)
    path = world_in(tmp_path, "", f"attached-{os.getpid()}")
    with worlds.World(path, "--rate", "20", "--until", "") as world, world.client() as asked:
        world.runs("gLaser", "physics")
        words = ["bridge", "rosbag", bag, "--speed", "0", "--topics", '{"/base" = "scan"}']
        words += ["--name", "bag", "--connect", world.endpoint(), "--world", world.name]
        with worlds.Run(tmp_path, *words) as played:
            assert played.ends() == 0
        assert "has ended" in "\n".join(played.output)
        assert "no more events; leaving the world" in played.text
        worlds.eventually(lambda: state_of(asked, "bag") == "left", "it has left")
        assert figures_of(asked, "bag") == {"readings": 40, "source": "ended"}
        join = JoinOptions(connect=world.endpoint(), world=world.name)
        with pytest.raises(MisuseError, match=r"--robot r11: .*; did you mean 'r1'"):
            bridge_source("rosbag", str(bag), join, {"robot": "r11"})
        torn = write(tmp_path / "torn.mcap", "no bag")
        words[2] = torn
        with worlds.Run(tmp_path, *words) as bag:
            assert bag.ends() == 1
        assert "not a readable bag" in "\n".join(bag.output)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["carmen", "nothing.log"], "file 'nothing.log' does not exist"),
        (["carmen", "some.log", "--speed", "fast"], "speed must be a number"),
        (["carmen", "some.log", "--speed", "-1"], "speed is -1"),
        (["carmen", "some.log", "--mount-x", "left"], "mount_x is 'left'"),
        (["rosbag", "some.log", "--topics", "scan"], "topics is 'scan'"),
    ],
)
def test_an_unplayable_file_is_reported_in_one_line(tmp_path, words, why):
    log_in(tmp_path)
    worlds = bus()
    done = worlds.here(tmp_path, "bridge", *words, "--connect", "tcp/127.0.0.1:1", "--world", "w")
    assert done.returncode != 0
    assert why in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
