"""Regions as processes: the string of one coordinator, interrupts, and processes that die."""

import json
import os
import re
import signal

import pytest
from running import MEMBERS, World, alive, children, eventually, here, minerva, summary, write_world

from minerva_bus.launch import region_journal
from minerva_bus.launch.region_child import RegionChild
from minerva_bus.launch.region_journal import RegionJournal
from minerva_bus.launch.region_process import RegionStart
from minerva_bus.runtime.region_links import ParcelArrived

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


def test_a_killed_region_repeats_its_frames_and_continues(path):
    with World(path, "--rate", 60, "--frames", 240, "--regions", 3, "--json") as world:
        world.says("region 1", "tick")
        os.kill(sorted(children(world.process.pid))[1], signal.SIGKILL)
        world.says("was killed by SIGKILL in frame", "a new process runs its frames again")
        assert world.summary()["digest"] == alone(path, 240)["digest"]


def test_an_error_in_code_stops_all_regions(path):
    (path.parent / "loud.py").write_text(
        LOUD.replace('print("tick")', 'raise ValueError("broken")')
    )
    done = minerva(path.parent, "run", path, "--rate", 0, "--regions", 2)
    assert done.returncode == 1
    assert re.search(r"steps, region [01], failed in frame 5; the world stops", done.stderr)


def test_a_region_is_not_repeated_forever_or_without_its_journal(tmp_path):
    journal = tmp_path / "journal"
    journal.touch()
    region = RegionChild(RegionStart(None, 0, {}, tmp_path, journal), None, -1)
    assert not region.may_continue(1)
    region.frame = 7
    assert [region.may_continue(-9) for _ in range(3)] == [True, True, False]
    region.frame = 8
    assert region.may_continue(-9)
    journal.unlink()
    region.frame = 9
    assert not region.may_continue(-9)


def test_a_journal_omits_an_entry_that_was_cut_off(tmp_path, monkeypatch):
    path, parcels = tmp_path / "journal", [ParcelArrived(n, bytes(n)) for n in (2, 0, 1)]
    journal = RegionJournal(path)
    journal.open()
    for parcel in parcels:
        journal.write(parcel)
    whole = path.stat().st_size
    os.truncate(path, whole - 1)
    assert list(RegionJournal(path).read()) == parcels[:2]
    journal.write(parcels[2])
    assert list(RegionJournal(path).read()) == parcels
    monkeypatch.setattr(region_journal, "MAX_BYTES", whole)
    journal.write(parcels[0])
    assert not path.exists()
