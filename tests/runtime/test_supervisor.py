"""The launcher alone: how it counts failures, and that nothing is left where it fails itself."""

# The values of these tests have narrower types than their declarations.
# pyright: reportArgumentType=false

import os
import subprocess
import sys

import pytest
from running import PATIENCE, write_world

from minerva_bus.launch.ending import how_ended, next_ended
from minerva_bus.launch.members import CALM, CALM_FRAMES, FIRST_WAIT, LONGEST_WAIT, Watched
from minerva_bus.launch.pipes import Pipes
from minerva_bus.launch.starters import Child
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
    watched = Watched(Process("a", restarts=9))
    waits = [watched.fail(0) for _ in range(10)]
    assert waits[:3] == [FIRST_WAIT, 2 * FIRST_WAIT, 4 * FIRST_WAIT]
    assert waits[8:] == [LONGEST_WAIT, None]
    assert watched.failures == 10


class Clock:
    """A machine of which only the time is used."""

    now = 100.0

    def monotonic(self):
        return self.now


def lives(watched, clock, seconds, frames, waited=0.0):
    """Let a member start, send hello, serve and fail; return the seconds until its restart."""
    watched.begin(Child("a", 1, -1))
    watched.come(7)
    clock.now += seconds
    watched.waited = waited
    return watched.fail(7 + frames)


def test_what_has_served_well_for_long_has_failed_for_the_first_time():
    clock = Clock()
    watched = Watched(Process("a"), clock, failures=5)
    assert lives(watched, clock, CALM + 1, CALM_FRAMES) == FIRST_WAIT
    assert watched.failures == 1


@pytest.mark.parametrize(("seconds", "frames", "waited"), [
    (CALM - 1, 1000, 0.0),
    (1000.0, CALM_FRAMES - 1, 0.0),
    (1000.0, 1000, 1000.0 - CALM + 1),
])  # fmt: skip
def test_what_has_not_served_well_for_long_fails_in_a_row(seconds, frames, waited):
    clock = Clock()
    watched = Watched(Process("a"), clock, failures=5)
    assert lives(watched, clock, seconds, frames, waited) is None
    assert watched.failures == 6


@pytest.mark.parametrize("hard", [0.1, CALM, 10 * CALM])
def test_what_stops_in_every_frame_is_given_up_whatever_its_deadline(hard):
    clock = Clock()
    watched = Watched(Process("a", restarts=3), clock)
    ends = [lives(watched, clock, hard + 0.2, 1, hard) for _ in range(4)]
    assert [end is None for end in ends] == [False, False, False, True]


def test_a_member_without_hello_is_given_up_despite_its_deadline():
    clock = Clock()
    watched = Watched(Process("a", restarts=2), clock)
    for left in (True, True, False):
        watched.begin(Child("a", 1, -1))
        clock.now += 10 * CALM
        assert (watched.fail(1000) is not None) == left


@pytest.mark.parametrize("policy", ["stop", "ignore"])
def test_what_is_not_to_be_restarted_is_not(policy):
    watched = Watched(Process("a", on_failure=policy))
    assert watched.fail(0) is None
    assert watched.restart_at is None


def test_what_left_and_is_wanted_again_is_started_at_once():
    watched = Watched(Process("a"))
    watched.leave()
    assert len(watched.times) == 1
    watched.restart()
    assert watched.restart_at is not None
    assert not watched.wanted


def test_a_pipe_is_read_to_its_end():
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


def test_an_end_is_reported_once():
    pid = os.fork()
    if not pid:
        os._exit(5)
    assert next_ended(wait=True) == (pid, 5)
