"""Regions as processes: the string of one coordinator, interrupts, and processes that die."""

import json
import os
import re
import signal

import pytest
from running import MEMBERS, World, alive, children, eventually, here, minerva, summary, write_world

LOUD = """
from yard import *

class LoudSteps(Steps, events=("eStep",)):
    def generate(self, tick):
        if tick.number == 5:
            print("tick")
        return super().generate(tick)
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "loud.py").write_text(LOUD)
    return write_world(tmp_path, MEMBERS.replace("yard:Steps", "loud:LoudSteps"))


def alone(path, frames):
    """The summary of the world in one process, with one coordinator."""
    words = "--in-process", "--rate", 0, "--frames", frames, "--json"
    return summary(here(path.parent, "run", path, *words))


def test_regions_in_processes_have_the_string_of_one_coordinator(path):
    regions = summary(minerva(path.parent, "run", path, "--rate", 0, "--regions", 3, "--json"))
    single = alone(path, 30)
    same = ("digest", "frames", "ended", "reached", "members", "steps")
    assert {name: regions[name] for name in same} == {name: single[name] for name in same}
    assert regions["regions"] == 3


def test_an_interrupt_ends_all_regions_after_the_same_frame(path):
    words = "--rate", 100, "--frames", 0, "--regions", 3, "--json"
    with World(path, *words) as world:
        for number in range(3):
            world.says(f"region {number}", "tick")
        processes = children(world.process.pid)
        assert len(processes) == 3
        world.kill(signal.SIGINT)
        assert world.ends() == 130, world.text
        ended = json.loads("\n".join(world.output))
    assert ended["ended"] == "interrupted"
    assert ended["digest"] == alone(path, ended["frames"])["digest"]
    eventually(lambda: not any(map(alive, processes)), "all processes have ended")


def test_a_region_that_dies_stops_the_world(path):
    with World(path, "--rate", 100, "--frames", 0, "--regions", 3) as world:
        world.says("region 1", "tick")
        processes = sorted(children(world.process.pid))
        os.kill(processes[1], signal.SIGKILL)
        assert world.ends() == 1
        killed = r"region \d was killed by SIGKILL in frame \d+; the world stops"
        assert re.search(killed, world.text)
    eventually(lambda: not any(map(alive, processes)), "all processes have ended")
