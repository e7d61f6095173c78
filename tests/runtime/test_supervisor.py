"""The supervisor alone: it counts failures, and if it fails, leaves no process behind."""

import os
import signal
import subprocess
import sys
from io import StringIO

import pytest
from running import MEMBERS, write_world

from minerva_bus.frame.messages import Hello
from minerva_bus.launch.child_processes import (
    FAILED,
    UNREADY,
    ChildProcess,
    LineReader,
    Pipes,
    how_ended,
    next_ended,
)
from minerva_bus.launch.console import Console, EndReport
from minerva_bus.launch.process_specs import ProcessSpec
from minerva_bus.launch.process_table import (
    HEALTHY_FRAMES,
    HEALTHY_SECONDS,
    MAX_RESTART_SECONDS,
    MIN_RESTART_SECONDS,
    NO_CAUSE,
    REPORT_SECONDS,
    FailureCause,
    Machine,
    SupervisedProcess,
)
from minerva_bus.launch.supervisor import (
    LATE_SECONDS,
    MAX_FAILURES,
    MAX_SUCCESSIONS,
    STOP_SECONDS,
    STOPPED_SECONDS,
    StoppedCoordinator,
    Supervisor,
)
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.runtime.participants import RAISED
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


STARTS, REASON = "tcp/127.0.0.1:1", "the lake is dry"
BLOCKED = FailureCause(blocked="did not answer for 30 s (blocked as above)")


class Deaf(Clock):
    """A machine whose coordinator never answers; `commands` are those that it was sent."""

    def __init__(self):
        self.commands = []
        self.stopped = False

    def write(self, descriptor, data):
        self.commands.append(data.decode().strip())

    def is_stopped(self, pid):
        return self.stopped


@pytest.fixture
def deaf(tmp_path):
    members = (
        MEMBERS + '[process.extra]\nservice = "each"\nevent = "eStep"\non_failure = "ignore"\n'
    )
    machine = Deaf()
    supervisor = Supervisor(
        read_world_file(write_world(tmp_path, members)), Console(StringIO()), 0.0, machine=machine
    )
    yield supervisor, machine
    supervisor._context.close()


def test_a_coordinator_has_a_successor_unless_it_fails_again_in_the_same_frame(deaf):
    succession = deaf[0]._coordinator
    assert not succession.may_continue(-9)  # It has never listened.
    deaf[0]._context.endpoint = STARTS
    assert not succession.may_continue(1)
    assert not succession.may_continue(0)
    answers = []
    for frame in (5, 5, 6, 6, 4, 9):
        succession.frame = frame
        answers.append(succession.may_continue(FAILED))
    assert answers == [True, True, True, True, False, True]
    succession.count = MAX_SUCCESSIONS - 1
    assert succession.may_continue(-9)
    succession.count = MAX_SUCCESSIONS
    assert not succession.may_continue(-9)


@pytest.mark.parametrize(("name", "code", "cause", "failures", "stops", "restarts"), [
    ("steps", -9, NO_CAUSE, 0, False, True),
    ("steps", -9, NO_CAUSE, 5, True, False),
    ("steps", UNREADY, FailureCause("steps", REASON), 0, False, True),
    ("steps", UNREADY, FailureCause("steps", REASON, final=True), 0, True, False),
    ("extra", -9, NO_CAUSE, 0, False, False),
    ("extra", UNREADY, FailureCause("extra", REASON), 0, True, False),
    ("steps", -9, BLOCKED, MAX_FAILURES - 1, False, True),
    ("walkers", -9, BLOCKED, MAX_FAILURES - 2, False, True),
    ("walkers", -9, BLOCKED, MAX_FAILURES - 1, True, False),
])  # fmt: skip
def test_what_follows_a_failure(deaf, name, code, cause, failures, stops, restarts):
    supervisor, machine = deaf
    process = supervisor._processes.get(name)
    process.started(ChildProcess(NOBODY, -1))
    process.cause, process.failures = cause, failures
    supervisor._ended(NOBODY, code)
    assert (process.restart_at is not None, "stop" in machine.commands) == (restarts, stops)
    assert (supervisor._ending.deadline == machine.now + STOP_SECONDS) == stops
    assert (name in supervisor.failure) == stops
    assert process.abandoned == (f"abandoned {name}" in machine.commands) == (not stops | restarts)


def test_the_same_error_in_the_same_frame_ends_the_world(deaf):
    supervisor, machine = deaf
    process, seen = supervisor._processes.get("steps"), []
    for text in ("failed in frame 3: KeyError", "failed in frame 4: KeyError") * 2:
        process.started(ChildProcess(NOBODY, -1))
        supervisor._on_log("steps", text)
        supervisor._ended(NOBODY, RAISED)
        seen.append((process.restart_at is not None, "stop" in machine.commands))
    assert seen == [(True, False), (True, False), (False, True), (False, True)]
    assert supervisor.failure == "steps failed in frame 3: KeyError"


def test_a_second_interrupt_kills_at_once_and_the_first_one_is_the_reason(deaf):
    supervisor, machine = deaf
    supervisor._interrupted(signal.SIGTERM)
    assert supervisor._ending.deadline == machine.now + STOP_SECONDS
    supervisor._interrupted(signal.SIGINT)
    assert (supervisor._ending.deadline, supervisor.failure) == (0.0, "terminated")
    assert machine.commands.count("stop") == 1


def test_an_interrupt_of_a_world_that_ends_leaves_it_its_time(deaf):
    supervisor, machine = deaf
    assert supervisor._ending.regular
    supervisor._ending.end_by(150.0)
    supervisor._interrupted(signal.SIGINT)
    assert (supervisor._ending.deadline, supervisor._ending.regular) == (150.0, False)
    assert machine.commands == []


@pytest.mark.parametrize(("code", "failure"), [(UNREADY, f"steps {REASON}"), (7, ""), (0, "")])
def test_a_process_that_ends_after_the_last_frame(deaf, code, failure):
    supervisor, machine = deaf
    process = supervisor._processes.get("steps")
    process.started(ChildProcess(NOBODY, -1))
    process.cause = FailureCause("steps", REASON)
    supervisor._on_stopping("the frames are over")
    supervisor._coordinator.count = 1
    supervisor._ended(NOBODY, code)
    assert (supervisor.failure, process.restart_at) == (failure, None)
    assert machine.commands == ["abandoned steps"]


def test_a_process_that_is_restarted_on_request_has_not_failed(deaf):
    supervisor, machine = deaf
    process = supervisor._processes.get("steps")
    process.started(ChildProcess(NOBODY, -1))
    supervisor._on_restart("steps")
    supervisor._ended(NOBODY, -9)
    assert (process.restart_at, process.restarting, process.failures) == (machine.now, False, 0)
    process.restart_at = None
    supervisor._on_stopping(REASON)
    supervisor._on_restart("steps")
    assert process.restart_at is None


@pytest.mark.parametrize(("reported", "deadline", "failure"), [
    (True, 150.0, ""), (False, 100.0 + REPORT_SECONDS, "the coordinator was killed by SIGKILL"),
])  # fmt: skip
def test_a_coordinator_that_ends_after_its_report_has_no_successor(
    deaf, monkeypatch, reported, deadline, failure
):
    supervisor, machine = deaf
    monkeypatch.setattr(machine, "close", lambda descriptor: None)
    ending, coordinator = supervisor._ending, supervisor._coordinator
    coordinator.child = ChildProcess(NOBODY, -1)
    supervisor._context.endpoint = STARTS if reported else ""
    if reported:
        ending.report = EndReport("the frames are over", 3, 0.0, 2)
        ending.end_by(deadline)
    supervisor._ended(NOBODY, -9)
    assert (coordinator.child, coordinator.count) == (None, 0)
    assert (ending.deadline, supervisor.failure) == (deadline, failure)
    # Nothing starts any more.
    supervisor._processes.enqueue(supervisor._processes.get("steps"))
    supervisor._start_processes()
    assert not supervisor._processes.running


def test_the_deadline_and_the_cause_of_an_end(deaf):
    supervisor, machine = deaf
    ending = supervisor._ending
    ending.end_by(50.0)
    ending.end_by(60.0)
    assert ending.deadline == 50.0
    assert ending.regular
    supervisor._on_ended(
        reason=REASON, frames=3, last_frame_at=0.0, members=2, failed=True, incomplete=["a"]
    )
    assert not ending.regular
    assert ending.deadline == machine.now + REPORT_SECONDS
    ending.incomplete.append("b")
    summary = supervisor.summary()
    assert (supervisor.failure, summary.incomplete) == (REASON, ["a", "b"])
    ending.fail("its consequence")
    assert supervisor.failure == REASON
    ending.report = EndReport("the frames are over", 3, 0.0, 2)
    assert not ending.regular


def test_a_successor_is_told_who_starts_and_who_is_gone(deaf):
    supervisor, machine = deaf
    steps, walkers, extra = map(supervisor._processes.get, ("steps", "walkers", "extra"))
    steps.started(ChildProcess(NOBODY, -1))
    walkers.started(ChildProcess(NOBODY + 1, -1))
    walkers.joined("walkers", 0)
    extra.abandoned = True
    supervisor._coordinator.count = 1
    supervisor._on_listening(STARTS, STARTS)
    assert machine.commands == ["started steps", "abandoned extra"]
    machine.commands.clear()
    steps.child = None
    supervisor._on_stopping(REASON)
    supervisor._on_listening(STARTS, STARTS)
    assert machine.commands == [f"end {REASON}", "abandoned steps", "abandoned extra"]


def test_a_stopped_coordinator_is_given_up_unless_the_launcher_was_stopped_as_well():
    machine = Deaf()
    machine.stopped = True
    stopped, seconds = StoppedCoordinator(machine), range(int(STOPPED_SECONDS))
    assert not any(stopped.is_given_up(NOBODY, 100.0 + second) for second in seconds)
    assert stopped.is_given_up(NOBODY, 100.0 + STOPPED_SECONDS)
    assert not stopped.is_given_up(NOBODY + 1, 101.0 + STOPPED_SECONDS)
    assert not stopped.is_given_up(NOBODY + 1, 102.0 + 2 * STOPPED_SECONDS + LATE_SECONDS)
