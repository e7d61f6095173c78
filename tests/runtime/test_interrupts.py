"""Ctrl-C, SIGTERM and worse: a world ends within two seconds and leaves no process behind."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from running import (
    ALL_KINDS,
    MEMBERS,
    MINERVA,
    World,
    alive,
    environment,
    eventually,
    here,
    write_world,
)  # fmt: skip

from tests.patience import patience

AT_ONCE = 2.0


@pytest.fixture(autouse=True)
def hang_ups_arrive():
    """Also in tests that run under nohup, which ignores them; the world would inherit that."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def interrupted(world, number):
    """Send a signal to the launcher; returns its exit code. The specification sets the bound."""
    world.look()
    began = time.monotonic()
    world.kill(number)
    code = world.ends()
    assert time.monotonic() - began < patience(AT_ONCE)
    assert not [pid for pid in world.pids.values() if alive(pid)]
    assert not [*(world.folder / "runtime").glob("*.j*")], "neither lock nor journal"
    return code


@pytest.mark.parametrize(("number", "word"), [
    (signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated"), (signal.SIGHUP, "terminated"),
])  # fmt: skip
def test_a_running_world_ends_at_once(tmp_path, number, word):
    path = write_world(tmp_path, ALL_KINDS, frames=0, rate=20)
    with World(path, "--json") as world:
        world.runs("steps", "walkers", "water", "eye", "screen", "noise")
        assert interrupted(world, number) == 130
        assert f'"ended": "{word}"' in "\n".join(world.output)
        assert "Traceback" not in world.text


IN_A_TERMINAL = """
import os, pty, signal, sys
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # tests may run under nohup
pid, terminal = pty.fork()
if not pid:
    os.execv(sys.argv[1], sys.argv[1:])
shown = b""
while b"frame 2" not in shown:  # the line at the bottom counts frames
    shown += os.read(terminal, 4096)
os.close(terminal)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""
"""Start a command in its own terminal, close that at frame 2, and wait."""


@pytest.mark.parametrize("words", [(), ("--in-process",)])
def test_a_closed_terminal_ends_the_world_and_its_record_in_order(tmp_path, words):
    pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")
    path = write_world(tmp_path, frames=0, rate=20)
    command = [*MINERVA, "run", str(path), "--record", "run.mcap", *words]
    done = subprocess.run(
        [sys.executable, "-c", IN_A_TERMINAL, *command], cwd=tmp_path, env=environment(tmp_path),
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 130
    info = json.loads(here(tmp_path, "info", "run.mcap", "--json").stdout)
    assert info["complete"]
    assert not list((tmp_path / "runtime").glob("*.json"))


def test_a_hang_up_that_is_ignored_stays_ignored(tmp_path):
    path = write_world(tmp_path, frames=0, rate=20)
    with World(path, inside=("nohup",)) as world:
        world.runs("steps", "walkers")
        world.kill(signal.SIGHUP)
        with world.client() as asked:
            frame = asked.operator.status().frame
            eventually(lambda: asked.operator.status().frame > frame + 5, "it runs on")
        assert interrupted(world, signal.SIGINT) == 130


def test_also_while_it_runs_as_fast_as_it_can(tmp_path):
    path = write_world(tmp_path, frames=0, rate=0)
    with World(path) as world:
        world.runs("steps", "walkers")
        assert interrupted(world, signal.SIGINT) == 130
        assert "Traceback" not in world.text


@pytest.mark.parametrize("deed", ["loops", "sleeps"])
def test_also_while_a_member_hangs(tmp_path, deed):
    members = MEMBERS + f'\n[process.rascal]\nservice = "yard:Rascal"\ndeed = "{deed}"\n'
    with World(write_world(tmp_path, members, bus="soft = 0.1\nhard = 30.0")) as world:
        world.says("rascal", "has been waiting for it")
        assert interrupted(world, signal.SIGINT) == 130
        assert "Traceback" not in world.text


def test_also_while_a_member_is_frozen(tmp_path):
    with World(write_world(tmp_path, frames=0, rate=20, bus="soft = 0.2")) as world:
        os.kill(world.runs("steps", "walkers")["walkers"], signal.SIGSTOP)
        world.says("walkers", "has been waiting for it")
        assert interrupted(world, signal.SIGINT) == 130


def test_also_while_the_coordinator_is_frozen(tmp_path):
    with World(write_world(tmp_path, frames=0, rate=20), "--json") as world:
        pids = set(world.runs("steps", "walkers").values())
        (coordinator,) = set(world.pids.values()) - pids
        eventually(lambda: world.members() and world.frame > 20, "some frames")
        os.kill(coordinator, signal.SIGSTOP)
        assert interrupted(world, signal.SIGTERM) == 130
        summary = json.loads("".join(world.output))
    assert (summary["ended"], summary["digest"], summary["members"]) == ("terminated", None, 2)
    assert summary["frames"] > 0


def test_also_before_the_first_frame(tmp_path):
    members = MEMBERS + '\n[process.absent]\ncommand = ["sleep", "1000"]\n'
    with World(write_world(tmp_path, members, bus="soft = 0.2")) as world:
        world.says("absent", "has been waiting for it")
        assert interrupted(world, signal.SIGINT) == 130
        assert any("no frame was completed" in line for line in world.output)
        assert "0.00 s (" not in "".join(world.output)


def test_a_second_ctrl_c_ends_it_without_a_word(tmp_path):
    members = MEMBERS + '\n[process.rascal]\nservice = "yard:Rascal"\ndeed = "loops"\n'
    with World(write_world(tmp_path, members, bus="soft = 0.1")) as world:
        world.says("rascal", "has been waiting for it")
        world.look()
        world.kill(signal.SIGINT)
        world.kill(signal.SIGINT)
        assert world.ends() in (1, 130)
        world.gone()


@pytest.mark.parametrize("children", [
    '["sleep", "1000"]', '["sh", "-c", "sleep 1000 & sleep 1000"]',
])  # fmt: skip
def test_a_command_and_what_it_started_end_too(tmp_path, children):
    members = MEMBERS + f"\n[process.other]\ncommand = {children}\n"
    with World(write_world(tmp_path, members, bus="soft = 0.2")) as world:
        world.says("other", "has been waiting for it")
        assert interrupted(world, signal.SIGTERM) == 130
        world.gone()


def test_processes_of_a_command_end_with_it(tmp_path):
    members = MEMBERS + (
        '\n[process.other]\ncommand = ["sh", "-c", "sleep 1000 & echo $! ; kill -TERM $$"]\n'
        'on_failure = "ignore"\n'
    )
    with World(write_world(tmp_path, members, frames=0, rate=20)) as world:
        world.says("other │ was killed by SIGTERM; continuing without it")
        (left,) = [line.split()[-1] for line in world.lines if line.startswith("other │ ")][:1]
        eventually(lambda: not alive(int(left)), "what it had started is gone")
        world.runs("steps", "walkers")


def test_a_command_that_is_not_there_is_named(tmp_path):
    members = MEMBERS + '\n[process.other]\ncommand = ["no-such-program"]\nrestarts = 0\n'
    with World(write_world(tmp_path, members)) as world:
        assert world.ends() == 2
        assert "no-such-program" in world.text
        assert "Traceback" not in world.text


@pytest.mark.parametrize("more", [
    "", '\n[process.other]\ncommand = ["sleep", "1000"]\n',
    '\n[process.rascal]\nservice = "yard:Rascal"\ndeed = "loops"\nframe = 0\n',
])  # fmt: skip
def test_nothing_survives_a_launcher_that_is_killed(tmp_path, more):
    with World(write_world(tmp_path, MEMBERS + more, frames=0, rate=20)) as world:
        if more:
            eventually(world.members, "it answers")
            eventually(lambda: world.look() or len(world.pids) >= 4, "all have started")
        else:
            world.runs("steps", "walkers")
        world.look()
        world.kill(signal.SIGKILL)
        world.gone()


def test_a_world_that_was_killed_may_be_run_again_at_once(tmp_path):
    path = write_world(tmp_path, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        world.look()
        world.kill(signal.SIGKILL)
        world.ends()
        with World(path, "--frames", "3", "--json") as again:
            assert again.summary()["frames"] == 3
        world.gone()


def test_in_one_process(tmp_path):
    path = write_world(tmp_path, MEMBERS + '\n[process.screen]\nservice = "yard:Screen"\nsaid = true\n',
                       frames=0, rate=20)  # fmt: skip
    for number in (signal.SIGINT, signal.SIGTERM):
        with World(path, "--in-process") as world:
            eventually(lambda w=world: "frame 3" in w.text, "frames go by")
            assert interrupted(world, number) == 130
            assert "Traceback" not in world.text
            assert "interrupted" in "\n".join(world.output)
