"""The launcher alone: how it counts failures, and that nothing is left where it fails itself."""

import os
import subprocess
import sys
import time

import pytest
from running import PATIENCE, write_world

from minerva_bus.launch.ending import how_ended, next_ended
from minerva_bus.launch.members import CALM, FIRST_WAIT, LONGEST_WAIT, Watched
from minerva_bus.launch.pipes import Pipes
from minerva_bus.launch.worldfile import Process

FAILING = """
import os, sys
from pathlib import Path
from minerva_bus.launch.console import Console
from minerva_bus.launch.reading import read_world_file
from minerva_bus.launch.supervisor import Supervisor

class Broken(Console):
    def live(self, line):
        raise ZeroDivisionError("the launcher's own fault")

def descriptors():
    return sorted(entry.name for entry in Path("/dev/fd").iterdir())

before = descriptors()
supervisor = Supervisor(read_world_file(Path(sys.argv[1])), Broken(quiet=True), 0.0)
try:
    supervisor.run()
except ZeroDivisionError:
    assert descriptors() == before
try:
    os.waitpid(-1, os.WNOHANG)
except ChildProcessError:
    print("no child is left")
"""


def test_a_launcher_that_fails_leaves_nothing(tmp_path):
    path = write_world(tmp_path, frames=0, rate=50)
    given = {**os.environ, "MINERVA_RUNTIME_DIR": str(tmp_path / "runtime")}
    done = subprocess.run(
        [sys.executable, "-c", FAILING, str(path)], cwd=tmp_path, env=given, timeout=PATIENCE,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "no child is left\n", done.stderr
    assert "restart" not in done.stderr
    assert "another one goes on" not in done.stderr
    assert not list((tmp_path / "runtime").glob("*.json"))


def test_failures_are_counted_and_waited_for_longer_and_longer():
    watched = Watched(Process("a", restarts=9), started=time.monotonic())
    waits = [watched.fail() for _ in range(10)]
    assert waits[:3] == [FIRST_WAIT, 2 * FIRST_WAIT, 4 * FIRST_WAIT]
    assert waits[8:] == [LONGEST_WAIT, None]
    assert watched.failures == 10


def test_what_was_calm_for_long_has_failed_for_the_first_time():
    watched = Watched(Process("a"), failures=5, started=time.monotonic() - CALM - 1)
    assert watched.fail() == FIRST_WAIT
    assert watched.failures == 1


@pytest.mark.parametrize("policy", ["stop", "ignore"])
def test_what_is_not_to_be_restarted_is_not(policy):
    watched = Watched(Process("a", on_failure=policy))
    assert watched.fail() is None
    assert watched.restart_at is None


def test_what_left_and_is_wanted_again_is_started_at_once():
    watched = Watched(Process("a"))
    watched.leave()
    assert len(watched.times) == 1
    watched.restart()
    assert watched.restart_at is not None
    assert not watched.wanted


def test_a_pipe_is_heard_until_its_end():
    pipes, heard = Pipes(), []
    read, write = os.pipe()
    os.set_blocking(read, False)
    pipes.listen(read, lambda: heard.append(pipes.read(read)))
    os.write(write, b"a")
    pipes.wait(PATIENCE)
    assert pipes.read(read) == b""
    os.close(write)
    pipes.wait(PATIENCE)
    assert heard == [b"a", None]
    pipes.close()


def test_exit_codes_in_words():
    assert how_ended(3) == "ended with exit code 3"
    assert how_ended(-9) == "was killed by SIGKILL"


def test_an_end_is_told_once():
    pid = os.fork()
    if not pid:
        os._exit(5)
    assert next_ended(wait=True) == (pid, 5)
