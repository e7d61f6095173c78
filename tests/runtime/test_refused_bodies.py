"""A norm rejects a step: bodies agree with the string on the bus, on resume and on restart."""

import os
import shutil
import signal
from itertools import pairwise
from pathlib import Path

import pytest
from running import World, eventually, here, minerva, summary

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

from minerva_bus.grammar.scene import agents
from minerva_bus.log.record import Record

FILE = """
[world]
name = "carts"
string = "ACart#a · ACart#b<x=-2> · ACart#c<x=-6>"
vocabulary = "carts:vocabulary"
order = ["eBody", "eStep"]
seed = 3
frames = 24

[norm.wall]
applies = "ACart"
where = "x > 3"

[process.clock]
service = "carts:Clock"

[process.motor]
service = "carts:Motor"

[process.carts]
agents = "carts:Cart"
"""


@pytest.fixture
def path(tmp_path):
    shutil.copy(Path(__file__).with_name("carts.py"), tmp_path)
    (tmp_path / "carts.toml").write_text(FILE, encoding="utf-8")
    return tmp_path / "carts.toml"


def states_of(record):
    """The carts' states before each frame, and after the last."""
    with Record(record) as read:
        return [{agent.id: agent.state for agent in agents(string)} for _, string in read.strings()]


def refused_frames(record):
    """Frames in which a cart does not move; checks that all bodies are at their carts."""
    states, refused = states_of(record), []
    first = {who: state["x"] for who, state in states[0].items()}
    for number, (before, after) in enumerate(pairwise(states)):
        for who, state in after.items():
            assert state["body"] == pytest.approx(before[who]["x"] - first[who]), (number, who)
            assert state["x"] <= 3
        stays = [who for who, state in after.items() if state["x"] == before[who]["x"]]
        refused += [number] if number and stays else []
    return refused


def test_bodies_stay_with_the_string_over_the_bus_in_any_layout(path):
    folder = path.parent
    run = ("run", path, "--json", "--record")
    alone = summary(here(folder, *run, "alone.mcap", "--in-process"))
    whole = summary(minerva(folder, *run, "bus.mcap", "--set", "carts.processes=2"))
    assert whole["digest"] == alone["digest"]
    assert len(refused_frames(folder / "bus.mcap")) > 10


def test_a_run_that_is_cut_after_a_refused_step_goes_on_as_if_it_never_was(path):
    folder = path.parent
    here(folder, "run", path, "--in-process", "--record", "whole.mcap")
    refused = refused_frames(folder / "whole.mcap")
    for stop in (refused[0], refused[0] + 1, refused[1] + 1, refused[-1]):
        cut = ("--frames", stop, "--in-process", "--record", "cut.mcap", "--force")
        assert here(folder, "run", path, *cut).returncode == 0
        on = ("--frames", 24, "--record", "on.mcap", "--force", "--in-process")
        assert here(folder, "run", path, "--resume", "cut.mcap", *on).returncode == 0
        assert here(folder, "diff", "whole.mcap", "on.mcap").returncode == 0, stop
        refused_frames(folder / "on.mcap")


def test_a_motor_that_is_killed_carries_out_nothing_twice_and_nothing_refused(path):
    folder = path.parent
    whole = summary(here(folder, "run", path, "--in-process", "--frames", 400, "--json"))
    options = ("--frames", 400, "--rate", 100, "--record", "run.mcap", "--json")
    with World(path, *options) as world:
        for _ in range(2):
            old = world.runs("clock", "motor", "carts")["motor"]
            os.kill(old, signal.SIGKILL)
            eventually(lambda pid=old: world.runs("motor")["motor"] != pid, "another motor")
        ended = world.summary()
    assert ended["digest"] == whole["digest"]
    assert len(refused_frames(folder / "run.mcap")) > 100
