"""Large messages through shared memory: the same world, and no files left behind."""

import fcntl
import os
import signal

import numpy as np

from minerva_bus import parse
from minerva_bus.grammar.columns import column_bytes
from minerva_bus.launch.machine_resources import (
    SHARED_MEMORY,
    has_room,
    remove_orphans,
)
from tests.runtime.running import MEMBERS, World, eventually, minerva, summary, write_world
from tests.runtime.yard import Walker

BIG = "PDot<x=1> · " * 60_000


def left():
    """The shared-memory files without a lock; locked ones are in use by other sessions."""
    return {path for path in SHARED_MEMORY.glob("*.zenoh") if not locked(path)}


def locked(path):
    try:
        with path.open("r+") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except FileNotFoundError:
        return True  # It was removed before it could be opened.
    return False


def crowd(tmp_path, **world):
    """A world whose fragments exceed a megabyte."""
    string = f"AWalker#a<x=1>({BIG.rstrip(' ·')}) · AWalker#b<x=2>"
    return write_world(tmp_path, string=string, bus="shared_memory = true", **world)


def test_the_same_world_and_no_file_left(tmp_path):
    before = left()
    path = crowd(tmp_path, frames=3)
    plain = summary(minerva(tmp_path, "run", path, "--in-process", "--json"))
    shared = summary(minerva(tmp_path, "run", path, "--json"))
    assert shared["digest"] == plain["digest"]
    eventually(lambda: left() <= before, "nothing is left")


def test_no_file_is_left_by_killed_members_or_interrupts(tmp_path):
    before = left()
    with World(crowd(tmp_path, frames=0)) as world:
        pids = world.runs("steps", "walkers")
        os.kill(pids["walkers"], signal.SIGKILL)
        world.says("walkers", "restart 1")
        world.kill(signal.SIGINT)
        assert world.ends(10) == 130
        world.gone()
    eventually(lambda: left() <= before, "nothing is left")


def test_a_sweep_takes_unlocked_files(tmp_path):
    for name in ("mine.zenoh", "dead.zenoh", "other"):
        (tmp_path / name).write_bytes(b"x")
    with (tmp_path / "mine.zenoh").open("r+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert remove_orphans(tmp_path) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"mine.zenoh", "other"}


def test_large_populations_are_what_it_is_for():
    x = np.zeros(100_000)
    assert column_bytes(Walker.many("w", len(x), x=x)) >= x.nbytes
    assert column_bytes(parse("AWalker#a<x=1> · PDot<x=2>")) == 0


def test_no_room_is_no_error(tmp_path, monkeypatch):
    assert has_room(1, tmp_path)
    assert not has_room(1 << 60, tmp_path)
    monkeypatch.setattr(
        os, "access", lambda path, mode: False
    )  # As on a read-only mount, also for root.
    assert not has_room(1, tmp_path)
    assert not has_room(1, tmp_path / "nowhere")


def test_the_option_is_true_or_false(tmp_path):
    path = write_world(tmp_path, MEMBERS, bus='shared_memory = "perhaps"')
    done = minerva(tmp_path, "check", path)
    assert done.returncode == 1
    assert "shared_memory must be true or false" in done.stderr
