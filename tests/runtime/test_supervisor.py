"""The supervisor alone: it counts failures, and if it fails, leaves no process behind."""

import os
import subprocess
import sys
from io import StringIO

import pytest
from running import write_world

from minerva_bus.frame.messages import Hello
from minerva_bus.launch.child_processes import (
    ChildProcess,
    LineReader,
    Pipes,
    how_ended,
    next_ended,
)
from minerva_bus.launch.console import Console
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.process_table import (
    HEALTHY_FRAMES,
    HEALTHY_SECONDS,
    MAX_RESTART_SECONDS,
    MIN_RESTART_SECONDS,
    Machine,
    SupervisedProcess,
)
from minerva_bus.launch.supervisor import Supervisor
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides
from tests.patience import patience

FAILING = """
import os, sys
from pathlib import Path
from minerva_bus.launch.console import Console
from minerva_bus.launch.world_files import read_world_file
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
    path = write_world(tmp_path, frames=0, rate=20)
    given = {**os.environ, "MINERVA_RUNTIME_DIR": str(tmp_path / "runtime")}
    done = subprocess.run(
        [sys.executable, "-c", FAILING, str(path)], cwd=tmp_path, env=given,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "no child is left\n", done.stderr
    assert "restart" not in done.stderr
    assert "successor" not in done.stderr
    assert not list((tmp_path / "runtime").glob("*.json"))


def test_each_failure_in_a_row_doubles_the_delay():
    process = SupervisedProcess((ProcessSpec("a", restarts=9),))
    waits = [process.fail(0) for _ in range(10)]
    assert waits[:3] == [MIN_RESTART_SECONDS, 2 * MIN_RESTART_SECONDS, 4 * MIN_RESTART_SECONDS]
    assert waits[8:] == [MAX_RESTART_SECONDS, None]
    assert process.failures == 10


NOBODY = 1 << 30
"""A process id that no system gives. To signal 1 by mistake would be to signal all processes."""


@pytest.mark.parametrize("pid", [-1, 0, 1])
def test_only_children_are_killed(monkeypatch, pid):
    signalled = []
    monkeypatch.setattr("os.kill", lambda *args: signalled.append(args))
    monkeypatch.setattr("os.killpg", lambda *args: signalled.append(args))
    for kill in (Machine().kill, Machine().kill_group):
        with pytest.raises(ValueError, match=f"^{pid} is not the process id of a child$"):
            kill(pid)
    assert not signalled
    assert Hello("a", 7, about={"pid": pid}).pid == 0


class Clock(Machine):
    """A machine with a clock only, which signals nobody."""

    now = 100.0

    def kill(self, pid):
        """Do nothing."""

    def kill_group(self, pid):
        """Do nothing."""

    def monotonic(self):
        return self.now


def lives(process, clock, seconds, frames, waited=0.0):
    """Let a member start, join, work and fail; returns the seconds until its restart."""
    process.started(ChildProcess(NOBODY, -1))
    process.joined("a", 7)
    clock.now += seconds
    process.waited = waited
    return process.fail(7 + frames)


def test_a_healthy_process_starts_with_no_failures_counted():
    clock = Clock()
    process = SupervisedProcess((ProcessSpec("a"),), clock, failures=5)
    assert lives(process, clock, HEALTHY_SECONDS + 1, HEALTHY_FRAMES) == MIN_RESTART_SECONDS
    assert process.failures == 1


@pytest.mark.parametrize(("frames", "waited", "killed", "delay"), [
    (HEALTHY_FRAMES, 0.0, True, 0.0),
    (HEALTHY_FRAMES - 1, 0.0, True, 2 * MIN_RESTART_SECONDS),
    (HEALTHY_FRAMES, 0.5, True, 2 * MIN_RESTART_SECONDS),
    (HEALTHY_FRAMES, 0.0, False, 2 * MIN_RESTART_SECONDS),
])  # fmt: skip
def test_a_process_that_is_killed_while_it_works_is_restarted_at_once(
    frames, waited, killed, delay
):
    process = SupervisedProcess((ProcessSpec("a"),), Clock(), failures=1)
    process.started(ChildProcess(NOBODY, -1))
    process.joined("a", 7)
    process.waited = waited
    assert process.fail(7 + frames, killed=killed) == delay
    assert process.failures == 2


@pytest.mark.parametrize(("seconds", "frames", "waited"), [
    (HEALTHY_SECONDS - 1, 1000, 0.0),
    (1000.0, HEALTHY_FRAMES - 1, 0.0),
    (1000.0, 1000, 1000.0 - HEALTHY_SECONDS + 1),
])  # fmt: skip
def test_a_process_that_was_not_healthy_fails_in_a_row(seconds, frames, waited):
    clock = Clock()
    process = SupervisedProcess((ProcessSpec("a"),), clock, failures=5)
    assert lives(process, clock, seconds, frames, waited) is None
    assert process.failures == 6


@pytest.mark.parametrize("hard", [0.1, HEALTHY_SECONDS, 10 * HEALTHY_SECONDS])
def test_a_process_that_hangs_in_every_frame_is_given_up_whatever_its_deadline(hard):
    clock = Clock()
    process = SupervisedProcess((ProcessSpec("a", restarts=3),), clock)
    ends = [lives(process, clock, hard + 0.2, 1, hard) for _ in range(4)]
    assert [end is None for end in ends] == [False, False, False, True]


def test_a_process_that_never_joins_is_given_up_whatever_its_deadline():
    clock = Clock()
    process = SupervisedProcess((ProcessSpec("a", restarts=2),), clock)
    for left in (True, True, False):
        process.started(ChildProcess(NOBODY, -1))
        clock.now += 10 * HEALTHY_SECONDS
        assert (process.fail(1000) is not None) == left


@pytest.mark.parametrize("policy", ["stop", "ignore"])
def test_other_policies_do_not_restart(policy):
    process = SupervisedProcess((ProcessSpec("a", on_failure=policy),))
    assert process.fail(0) is None
    assert process.restart_at is None


def test_a_process_that_has_exited_is_restarted_at_once_on_request():
    process = SupervisedProcess((ProcessSpec("a"),))
    process.exited()
    assert len(process.due) == 1
    process.restart()
    assert process.restart_at is not None
    assert not process.restarting


def test_a_pipe_is_read_until_its_end():
    pipes, heard = Pipes(), []
    read, write = os.pipe()
    os.set_blocking(read, False)
    pipes.listen(read, lambda: heard.append(pipes.read(read)))
    os.write(write, b"a")
    pipes.wait(patience())
    assert pipes.read(read) == b""
    os.close(write)
    pipes.wait(patience())
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


def test_a_line_reader_finishes_with_an_unterminated_line_although_the_pipe_stays_open():
    pipes, lines = Pipes(), []
    read, write = os.pipe()
    os.set_blocking(read, False)
    reader = LineReader(pipes, read, lines.append)
    os.write(write, b"first\nsec")
    pipes.wait(patience())
    assert lines == ["first"]
    os.write(write, b"ond")
    reader.finish()
    assert lines == ["first", "second"]
    assert not reader.open
    os.close(write)
    pipes.close()


def test_the_reason_of_a_coordinator_is_the_first_line_of_its_last_error(tmp_path):
    stream = StringIO()
    supervisor = Supervisor(read_world_file(write_world(tmp_path)), Console(stream), 0.0)
    supervisor._context.endpoint = "tcp/127.0.0.1:1"
    lines = ["at first", "Goat.picture: ZeroDivisionError", "  goat.py:28", "    1 / 0"]
    for line in lines:
        supervisor._receive_line(line)
    assert [line.partition("│ ")[2] for line in stream.getvalue().splitlines()] == lines
    assert supervisor._last_line == "Goat.picture: ZeroDivisionError"
    supervisor._context.close()


@pytest.mark.parametrize("stopping", [False, True])
@pytest.mark.parametrize(("code", "incomplete"), [
    (0, []), (7, ["painter: output incomplete (ended with exit code 7)"]),
])  # fmt: skip
def test_a_run_without_the_output_of_a_view_is_incomplete(tmp_path, stopping, code, incomplete):
    # Its service takes no options: `hard` is one of its process.
    given = Overrides(views=("yard:Painter:hard=120",))
    file = read_world_file(write_world(tmp_path), given)
    assert file.deadlines.of("painter").hard == 120
    assert file.deadlines.of("steps") == file.patience
    supervisor = Supervisor(file, Console(StringIO()), 0.0, machine=Clock())
    process = list(supervisor._processes)[-1]
    process.started(ChildProcess(NOBODY, -1))
    process.joined(process.name, 0)
    if stopping:
        supervisor._on_stopping("the frames are over")
    supervisor._ended(NOBODY, code)
    assert supervisor.summary().incomplete == incomplete
    supervisor._context.close()
