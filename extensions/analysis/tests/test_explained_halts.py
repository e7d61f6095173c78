"""`minerva explain WORLD` names who is awaited, in which call, what follows and what to do."""

import json
import os
import shutil
import signal
from pathlib import Path

import pytest

from minerva_analysis.explaining import explain_world
from minerva_bus.errors import BusError
from tests.runtime.running import Run, World, eventually, here

WORLD = """
[world]
name = "NAME"
string = "AMind#mind · APerson#anna"
vocabulary = "town:vocabulary"
rate = 20
frames = 0
people = ["eHappy"]

[bus]
soft = 0.1
hard = 300

[process.folk]
agents = ["town:Person", "mind"]
"""
FAULTS = """
[process.clock]
service = "faulty:Clock"

[process.llm]
service = "llm"
backend = "faulty:decide"
wait = true

[norm.fence]
applies = "APerson"
when = "steps > 3"
"""
REMOTE = """
[process.far]
service = "faulty:Extra"
elsewhere = true
"""
ROOT = Path(__file__).parents[3]


def world_in(folder, tables):
    for module in ("extensions/assistants/tests/town.py", "tests/runtime/faulty.py"):
        shutil.copy(ROOT / module, folder)
    name = f"halts-{os.getpid()}-{folder.name}"
    path = folder / f"{name}.toml"
    path.write_text(WORLD.replace("NAME", name) + tables)
    (folder / "fault.txt").write_text("none")
    return path


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    path = world_in(tmp_path_factory.mktemp("faulty"), FAULTS)
    (path.parent / "fault.txt").write_text("llm")
    # Files of its processes have at most 16 kB, as on a disk that is full. Python would store
    # cut bytecode of what they import, and every later process would fail to read it.
    small = 'ulimit -f 16; export PYTHONDONTWRITEBYTECODE=1; exec "$@"'
    limited = ("bash", "-c", small, "bash")
    with World(path, "--record", "run.mcap", "--flush", "0", inside=limited) as world:
        cause(world, "pending request")
        yield world


def cause(world, kind, function=""):
    """The cause of this kind, once the world has it in a call of the function."""

    def named():
        try:
            with world.client() as client:
                halt = explain_world(client.operator)
        except BusError:  # A busy machine may answer late.
            return None
        assert len(halt.lines()) <= 24
        causes = (each for each in halt.causes if each.kind == kind)
        return next(
            (each for each in causes if not function or each.place.function == function), None
        )

    return eventually(named, lambda: f"a cause {kind!r}\n{world.text}")


def test_a_pending_request_of_a_study_that_waits(faulty):
    halt = cause(faulty, "pending request")
    assert halt.member == "llm"
    assert "wait = true" in halt.advice


def test_a_norm_that_rejects_everything(faulty):
    (faulty.folder / "fault.txt").write_text("none")
    halt = cause(faulty, "norm")
    assert halt.what.startswith("the norm fence rejects: it was broken ")
    assert ", the last by #anna in frame " in halt.what


@pytest.mark.parametrize(
    ("fault", "kind", "function", "advice"),
    [
        ("sleep", "sleeping call", "sleeps", "minerva restart clock"),
        ("lock", "deadlock", "waits_for_lock", "find its holder"),
        ("compile", "compilation", "compiles", "cache"),
    ],
)
def test_the_call_that_a_frame_waits_for(faulty, fault, kind, function, advice):
    (faulty.folder / "fault.txt").write_text(fault)
    halt = cause(faulty, kind, function)
    (faulty.folder / "fault.txt").write_text("none")
    assert halt.member == "clock"
    assert Path(halt.place.file).name == "faulty.py"
    assert advice in halt.advice
    eventually(lambda: "restarted in" in halt.then or cause(faulty, "norm"), "an outlook")


def test_a_stopped_process(faulty):
    pid = faulty.runs("clock")["clock"]
    os.kill(pid, signal.SIGSTOP)
    try:
        halt = cause(faulty, "stopped process")
    finally:
        os.kill(pid, signal.SIGCONT)
    assert halt.advice == f"kill -CONT {pid}"


def test_a_stopped_coordinator(faulty):
    pid = faulty.coordinator()
    os.kill(pid, signal.SIGSTOP)
    try:
        done = here(faulty.folder, "explain", faulty.name)
    finally:
        os.kill(pid, signal.SIGCONT)
    assert done.returncode
    assert f"has stopped 1 process of it; to continue: kill -CONT {pid}" in done.stderr


def test_a_slow_consumer_of_time(faulty):
    (faulty.folder / "fault.txt").write_text("slow")
    halt = cause(faulty, "slow consumer")
    assert halt.member == "clock"
    assert "of 20 frames per second" in halt.what
    assert halt.advice.endswith("couple, draw or ask it less often")


def test_no_events(faulty):
    (faulty.folder / "fault.txt").write_text("quiet")
    assert "minerva logs shows what its generators lack" in cause(faulty, "no events").advice


def test_a_full_disk(faulty):
    (faulty.folder / "fault.txt").write_text("none")
    halt = cause(faulty, "full disk")
    assert "run.mcap: File too large; it lacks " in halt.what
    assert halt.then == "frames are not recorded"


def test_a_paused_world_as_text_and_json(faulty):
    (faulty.folder / "fault.txt").write_text("none")
    assert here(faulty.folder, "pause").returncode == 0
    text = here(faulty.folder, "explain", faulty.name).stdout
    assert "does not advance (between frames)" in text
    assert f"do: minerva resume {faulty.name}" in text
    plain = json.loads(here(faulty.folder, "explain", "--json").stdout)
    assert plain["advances"] is False
    assert plain["causes"][0]["kind"] == "paused world"
    wrong = here(faulty.folder, "explain", faulty.name, "--attribute", "x")
    assert wrong.returncode == 2
    assert "--agent ID is missing" in wrong.stderr


def test_a_missing_member_and_a_lost_link(tmp_path):
    with World(world_in(tmp_path, REMOTE)) as world:
        halt = cause(world, "missing member")
        assert (halt.member, halt.what) == ("far", "far has not joined")
        words = ("attach", "faulty:Extra", "--name", "far", "--world", world.name)
        with Run(tmp_path, *words) as far:
            world.runs("far")
            far.kill()
            far.ends()
        assert cause(world, "lost link").member == "far"
