"""Coordinators are killed: a successor continues, members stay, and the string is the same."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
import zenoh
from running import (
    ALL_KINDS,
    MEMBERS,
    Run,
    World,
    alone,
    environment,
    eventually,
    here,
    minerva,
    summary,
    write_world,
)  # fmt: skip

from tests.patience import patience

LOCKSTEP = ALL_KINDS.split("[process.noise]")[0]
NAMES = ("steps", "walkers", "water", "eye", "screen")


def test_a_coordinator_that_is_killed_is_followed_and_members_stay(tmp_path):
    path = write_world(tmp_path, LOCKSTEP, frames=150, rate=30)
    undisturbed = alone(path)
    with World(path, "--json") as world:
        before = world.runs(*NAMES)
        for _ in range(3):
            world.kill_coordinator()
            assert world.runs(*NAMES) == before
        summary = world.summary()
        world.gone()
    assert (summary["frames"], summary["digest"]) == (150, undisturbed["digest"])
    assert summary["frames_before"] == 0
    assert summary["wall_seconds"] >= 149 / 30 - 0.1, "since the first coordinator's first frame"
    assert summary["frames_per_second"] <= 31
    assert (
        "coordinator │ was killed by SIGKILL; a successor continues from its journal (3 of"
        in world.text
    )
    assert "giving up" not in world.text
    assert not list((tmp_path / "runtime").glob("*.journal*"))


def failing_coordinator(folder, words, frame, times):
    """Run a world whose coordinator raises an exception in a frame, `times` times.

    The file `begun` lists the frames that began.
    """
    script = folder / "failing.py"
    script.write_text(FAILING.format(words=[*map(str, words)], frame=frame, times=times))
    return subprocess.run(
        [sys.executable, script], cwd=folder, env=environment(folder), capture_output=True,
        text=True, stdin=subprocess.DEVNULL,
    )  # fmt: skip


FAILING = """
import sys
from pathlib import Path
from minerva_bus.frame.stimuli import Begin
from minerva_bus.runtime.runner import Runner
from minerva_bus.cli.main import main

handle, count = Runner.handle, Path("failures")

def failing(self, stimulus):
    done = len(count.read_text()) if count.exists() else 0
    if isinstance(stimulus, Begin):
        with Path("begun").open("a") as begun:
            print(self.algorithm.frame, file=begun)
    if self.algorithm.frame == {frame} and done < {times}:
        count.write_text("x" * (done + 1))
        raise LookupError("a defect of ours")
    handle(self, stimulus)

Runner.handle = failing
sys.argv = ["minerva", *{words!r}]
main()
"""


def test_a_coordinator_that_fails_is_followed_as_one_that_is_killed(tmp_path):
    path = write_world(tmp_path, LOCKSTEP, frames=40)
    undisturbed = alone(path)
    done = failing_coordinator(tmp_path, ("run", path, "--json"), frame=20, times=2)
    assert summary(done)["digest"] == undisturbed["digest"]
    assert "failed (LookupError: a defect of ours); a successor continues from its journal" in (
        done.stderr
    )
    # A world that runs once more from its beginning has the same digest.
    begun = [int(frame) for frame in (tmp_path / "begun").read_text().split()]
    assert begun == sorted(begun)
    assert {*begun} == {*range(40)}
    assert not list((tmp_path / "runtime").glob("*.journal*"))


def test_a_coordinator_that_fails_again_and_again_in_one_frame_ends_the_world(tmp_path):
    path = write_world(tmp_path, LOCKSTEP, frames=40)
    done = failing_coordinator(tmp_path, ("run", path, "--json"), frame=20, times=99)
    assert done.returncode == 1
    assert "a defect of ours" in done.stderr
    assert not list((tmp_path / "runtime").glob("*.journal*"))
    assert 1 < len((tmp_path / "failures").read_text()) < 10


def test_a_world_without_a_journal_ends_with_its_coordinator(tmp_path):
    path = write_world(tmp_path, MEMBERS, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        pid = world.coordinator()
        # A coordinator that notices the missing file ends by itself.
        os.kill(pid, signal.SIGSTOP)
        (journal,) = (tmp_path / "runtime").glob("*.journal")
        journal.unlink()
        os.kill(pid, signal.SIGKILL)
        assert world.ends() == 1
        assert f"{journal}: there is no journal, so no other coordinator can continue" in world.text
        world.gone()


def test_members_and_coordinator_are_killed_at_once(tmp_path):
    path = write_world(tmp_path, LOCKSTEP, frames=200, rate=60)
    undisturbed = alone(path)
    with World(path, "--json") as world:
        pids = world.runs(*NAMES)
        os.kill(pids["water"], signal.SIGKILL)
        os.kill(pids["walkers"], signal.SIGKILL)
        world.kill_coordinator()
        summary = world.summary()
    assert summary["digest"] == undisturbed["digest"]


def test_guests_are_waited_for_and_a_paused_world_stays_paused(tmp_path):
    path = write_world(tmp_path, MEMBERS, frames=60, rate=20)
    undisturbed = alone(path)
    with World(path, "--json") as world:
        world.runs("steps", "walkers")
        with world.client() as asked:
            asked.operator.pause()
        words = ("attach", "yard:Walker", "--name", "guest", "--world", world.name)
        with Run(tmp_path, *words, "--connect", world.endpoint()) as guest:
            guest.says("guest: joining")
            world.runs("guest")
            world.kill_coordinator()
            world.runs("guest", "steps")
            with world.client() as asked:
                assert asked.operator.status().paused
                asked.operator.resume()
            summary = world.summary()
            assert guest.ends() == 0
    assert summary["digest"] == undisturbed["digest"]


@pytest.mark.parametrize("spec", ["yard:Steps", "yard:Walker"])
def test_a_guest_that_returned_and_dies_is_not_waited_for(tmp_path, spec):
    path = write_world(tmp_path, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        words = ("attach", spec, "--name", "guest", "--world", world.name)
        with Run(tmp_path, *words, "--connect", world.endpoint()) as guest:
            world.runs("guest")
            world.kill_coordinator()
            world.runs("guest", "steps")
            assert not world.members()["guest"]["expected"]
            guest.kill()
            guest.ends()
        eventually(lambda: world.members().get("guest", {}).get("state") == "left", "it has left")
        before = world.frame
        eventually(lambda: world.members() and world.frame > before, "the world goes on")
    assert "guest │ is gone" in world.text
    assert "waits for it" not in world.text


def test_a_record_goes_on_with_the_coordinator_that_follows(tmp_path):
    pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")
    path = write_world(tmp_path, LOCKSTEP, frames=250, rate=60, record="run.mcap", flush=0.1)
    undisturbed = alone(path, "--record", "alone.mcap")
    alone(path, "--record", "run.mcap", "--frames", 5)
    earlier = (tmp_path / "run.mcap").read_bytes()
    with World(path, "--json") as world:
        world.runs(*NAMES)
        world.kill_coordinator()
        assert world.summary()["digest"] == undisturbed["digest"]
    assert "not in the record" not in world.text
    answer = json.loads(here(tmp_path, "info", "run.mcap", "--json").stdout)
    assert (answer["frames"], answer["complete"]) == (250, True)
    assert here(tmp_path, "diff", "alone.mcap", "run.mcap").returncode == 0
    assert (tmp_path / "run.old.mcap").read_bytes() == earlier


def test_a_world_with_a_journal_goes_on_whatever_was_killed(tmp_path):
    counts = '\n[process.counts]\nservice = "yard:Counts"\n'
    path = write_world(tmp_path, LOCKSTEP + counts, frames=600, rate=60)
    undisturbed = alone(path)
    words = ("--journal", tmp_path / "kept")
    with World(path, *words) as world:
        world.runs(*NAMES)
        world.kill()
        world.ends()
        world.gone()
    with World(path, *words, "--rate", 40) as world:
        world.says("continuing from frame", "of its journal")
        world.says("Counts of [process.counts] changes count and has no `save`")
        world.runs(*NAMES)
        assert json.loads(here(tmp_path, "list", "--json").stdout)["rate"] == 40
        world.kill(signal.SIGTERM)
        world.ends()
    assert list((tmp_path / "kept").glob("*.journal"))
    ended = summary(minerva(tmp_path, "run", path, *words, "--rate", 0, "--json"))
    assert ended["digest"] == undisturbed["digest"]
    assert 0 < ended["frames_before"] < 600
    ran = (600 - ended["frames_before"]) / ended["wall_seconds"]
    assert ended["frames_per_second"] == pytest.approx(ran, rel=0.02, abs=0.1)
    assert not list((tmp_path / "kept").iterdir())


@pytest.fixture
def router():
    """A Zenoh router between networks; returns its endpoint."""
    config = zenoh.Config()
    settings = {
        "mode": "router",
        "listen/endpoints": ["tcp/127.0.0.1:0"],
        "scouting/multicast/enabled": False,
        "adminspace/enabled": True,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        (reply,) = session.get(f"@/{session.zid()}/router", timeout=patience(5))
        answer = json.loads(reply.ok.payload.to_string())["locators"]
        yield next(locator for locator in answer if locator.startswith("tcp/127.0.0.1"))


def test_the_older_of_two_that_see_each_other_through_a_router_stops(tmp_path, router):
    """This happens when the two parts of a partitioned network are connected again."""
    path = write_world(tmp_path, MEMBERS, frames=0, rate=20)
    other = tmp_path / "elsewhere"
    other.mkdir()
    for name in (path.name, "yard.py"):
        shutil.copy(tmp_path / name, other / name)
    with World(path, "--connect", router, "--insecure") as older:
        older.runs("steps", "walkers")
        born = int(time.time())
        eventually(lambda: int(time.time()) > born, "a second has passed: epochs are seconds")
        with World(other / path.name, "--connect", router, "--insecure") as newer:
            assert older.ends() == 1
            assert "another coordinator runs the world" in older.text
            assert "of epoch" in older.text
            older.gone()
            newer.runs("steps", "walkers")
            newer.kill(signal.SIGINT)
            newer.ends()


def test_the_older_of_two_coordinators_stops(tmp_path):
    path = write_world(tmp_path, MEMBERS, frames=0, rate=20)
    kept = tmp_path / "kept"
    with World(path, "--journal", kept) as older:
        older.runs("steps", "walkers")
        # As on a machine that is suspended: its launcher would kill the coordinator.
        frozen = older.coordinator()
        older.kill(signal.SIGSTOP)
        os.kill(frozen, signal.SIGSTOP)
        other = tmp_path / "elsewhere"
        other.mkdir()
        path.rename(other / path.name)
        (tmp_path / "yard.py").rename(other / "yard.py")
        with World(other / path.name, "--journal", kept) as newer:
            newer.says("continuing from frame")
            newer.runs("steps", "walkers")
            older.look()
            for pid in older.pids.values():
                os.kill(pid, signal.SIGCONT)
            older.kill(signal.SIGCONT)
            assert older.ends() == 1
            assert "another coordinator runs the world" in older.text
            before = newer.members() and newer.frame
            eventually(lambda: newer.members() and newer.frame > before + 5, "the newer goes on")
            newer.kill(signal.SIGINT)
            newer.ends()
