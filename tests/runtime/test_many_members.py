"""Worlds of many members: they start in batches, get time to start, and end together."""

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from running import MINERVA, World, alive, environment, eventually

from minerva_bus.launch.machine_resources import MIN_CHECKED, cores
from minerva_bus.launch.process_table import SLOT_SECONDS, STARTS_PER_CORE

CHECKED = 1
"""The launcher creates one of them itself to check it against the world."""

CROWD = """
[world]
string = "PNothing"
vocabulary = "crowded:vocabulary"
frames = {frames}

[process.busy]
service = "crowded:Busy"
seconds = {seconds}
processes = {number}
"""


def crowd(folder, number, seconds=0.0, frames=1):
    shutil.copy(Path(__file__).with_name("crowded.py"), folder)
    path = folder / f"crowd-{os.getpid()}-{number}.toml"
    path.write_text(CROWD.format(number=number, seconds=seconds, frames=frames))
    return path


def most_at_once(folder):
    """Maximum number of overlapping starts, except those over half of `SLOT_SECONDS`."""
    texts = [path.read_text().splitlines() for path in folder.iterdir()]
    assert {len(lines) for lines in texts} == {1}, "a process has constructed the service twice"
    spans = [tuple(map(float, line.split())) for (line,) in texts]
    spans = [(begin, end) for begin, end in spans if end - begin < SLOT_SECONDS / 2]
    return max(sum(begin <= at < end for begin, end in spans) for at, _ in spans)


def test_many_members_start_in_turns_on_a_busy_machine(tmp_path):
    path = crowd(tmp_path, 60, seconds=0.05)
    burning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        with World(path, "--json") as world:
            done = world.summary()
    finally:
        for process in burning:
            process.kill()
            process.wait()
    assert (done["members"], done["frames"]) == (60, 1)
    assert "restart" not in world.text
    starts = tmp_path / "starts"
    assert len(list(starts.iterdir())) == 60 + CHECKED
    assert most_at_once(starts) <= STARTS_PER_CORE * cores()


def test_a_start_of_many_is_interrupted_and_leaves_nothing(tmp_path):
    with World(crowd(tmp_path, 60, seconds=0.2), "--json") as world:
        starts = tmp_path / "starts"
        eventually(lambda: starts.exists() and len(list(starts.iterdir())) > 5, "some start")
        world.look()
        world.kill(signal.SIGINT)
        assert world.ends() == 130
        started = {int(path.name) for path in starts.iterdir()}
        assert not [pid for pid in started | set(world.pids.values()) if alive(pid)]
    assert '"ended": "interrupted"' in "\n".join(world.output)
    assert len(started) < 60


def test_a_world_that_cannot_be_carried_is_refused_before_it_starts(tmp_path):
    files = 100

    def few_files():
        resource.setrlimit(resource.RLIMIT_NOFILE, (files, files))

    done = subprocess.run(
        [*MINERVA, "run", crowd(tmp_path, MIN_CHECKED)], cwd=tmp_path, env=environment(tmp_path),
        capture_output=True, text=True, preexec_fn=few_files, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert f"{MIN_CHECKED} processes cannot start here" in done.stderr
    assert f"{files} are allowed: raise the limit (ulimit -n" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert len(list((tmp_path / "starts").iterdir())) == CHECKED


def test_a_soft_limit_of_files_is_raised_as_far_as_needed(tmp_path):
    def few_files_at_first():
        hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        resource.setrlimit(resource.RLIMIT_NOFILE, (45, hard))

    done = subprocess.run(
        [*MINERVA, "run", crowd(tmp_path, 40), "--json"], cwd=tmp_path, env=environment(tmp_path),
        capture_output=True, text=True, preexec_fn=few_files_at_first, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


HANGING = """
import minerva_bus.launch.process_table as process_table
process_table.HEALTHY_SECONDS = 0.1
from minerva_bus.cli.main import main
main()
"""


UNREGISTERED = "import faulthandler, signal; faulthandler.unregister(signal.SIGUSR1); "


@pytest.mark.parametrize(
    ("begins", "ends"),
    # On a busy machine, a process may begin its work, or be able to write its stacks, too late.
    [
        ("", r"(did not answer for \S+ s( \(blocked as above\))?|was killed by SIGKILL)"),
        (UNREGISTERED, r"(did not answer for \S+ s|was killed by SIGKILL)"),
    ],
    ids=["with stacks", "without a handler for the request for stacks"],
)
def test_a_member_that_stops_in_every_frame_is_given_up(tmp_path, begins, ends):
    """Its deadline is longer than the time after which failures are forgotten."""
    (tmp_path / "stopping.py").write_text(
        "import time\nfrom minerva_bus import Generator, Primitive, Vocabulary\n"
        'vocabulary = Vocabulary.of(Primitive("PNothing"))\n'
        f"class Stops(Generator):\n    def generate(self, tick):\n        {begins}time.sleep(100)\n"
    )
    path = tmp_path / "stopping.toml"
    path.write_text(
        '[world]\nstring = "PNothing"\nvocabulary = "stopping:vocabulary"\n'
        '[process.stops]\nservice = "stopping:Stops"\nrestarts = 2\n'
        "[bus]\nsoft = 0.2\nhard = 0.4\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", HANGING, "run", path], cwd=tmp_path, env=environment(tmp_path),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    pattern = rf"stops │ {ends}, 3 times in a row; the world stops"
    assert re.search(pattern, done.stderr), done.stderr


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("number", [500, 1000])
def test_hundreds_of_members_start_with_few_words(tmp_path, number):
    began = time.monotonic()
    with World(crowd(tmp_path, number), "--json") as world:
        assert world.ends(580) == 0, world.text
        seconds = time.monotonic() - began
    # A frame that waits for a member says when that would be restarted.
    assert "restart 1 of " not in world.text
    assert f'"members": {number}' in "\n".join(world.output)
    assert len(world.lines) <= seconds
