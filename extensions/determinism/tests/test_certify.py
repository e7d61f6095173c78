"""`minerva certify` compares a world in all layouts, and finds state that deaths lose."""

import io
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from minerva_bus.errors import MisuseError
from minerva_bus.launch.child_processes import end_signals
from minerva_bus.launch.world_files import read_world_file
from minerva_determinism import layouts
from minerva_determinism.certificate import (
    FAILS,
    LEFT_OUT,
    NO_TIME,
    SAME,
    CertificatePlan,
    Check,
    certify,
)
from minerva_determinism.certify_command import CheckRows, interpreters
from minerva_determinism.emulation import emulated
from minerva_determinism.killer import kill_in_turn
from minerva_determinism.layouts import ALONE, APART
from minerva_determinism.positions import WHEN, deaths

pytest.importorskip("mcap")

ROOT = Path(__file__).parents[3]
ARM = os.environ.get("MINERVA_ARM", "")
"""A folder of `minerva certify --emulate aarch64 --setup`, if there is one."""
CODE = """\
import time

from minerva_bus import Agent, EventType, Generator, Vocabulary, on

eSun = EventType("eSun", light=float)


class Plant(Agent, symbol="APlant"):
    height: float = 0.0

    @on("eSun")
    def grow(self, sun, moment):
        self.height += sun.light * moment.random.random()


class Sun(Generator, events=("eSun",), when="each 2 frames"):
    def __init__(self):
        self.risen = 0.0

    def generate(self, tick):
        self.risen += 1.0
        return eSun(light=self.risen)
"""
SAVED = """
    def save(self):
        return {"risen": self.risen}

    def restore(self, saved):
        self.risen = saved["risen"]
"""
REST = """

vocabulary = Vocabulary.of(eSun, Plant)


def late():
    return time.time() > 0
"""
FILE = """\
[world]
string = "APlant#a · APlant#b"
vocabulary = "NAME:vocabulary"
frames = 12

[process.plants]
agents = "NAME:Plant"

[process.sun]
service = "NAME:Sun"
"""


@pytest.fixture
def world(tmp_path, request):
    """The path of a world whose sun saves its state, or does not."""

    def make(name, saved=SAVED):
        (tmp_path / f"{name}.py").write_text(CODE + saved + REST)
        path = tmp_path / f"{name}.toml"
        path.write_text(FILE.replace("NAME", name))
        return path

    return make


def plan(**changes):
    shown = []
    defaults = {
        "frames": 12,
        "processes": (),
        "pythons": {},
        "until": math.inf,
        "shown": shown.append,
        "begun": lambda *_: None,
    }
    return CertificatePlan(**{**defaults, **changes})


@pytest.mark.timeout(30)
def test_what_kills_processes_ends_with_its_certificate(tmp_path, monkeypatch):
    reading, writing = os.pipe()
    os.close(writing)
    monkeypatch.setenv("MINERVA_RUNTIME_DIR", str(tmp_path))
    with os.fdopen(reading) as over:
        monkeypatch.setattr(sys, "stdin", over)
        kill_in_turn(5, tmp_path / "killed.txt")


def test_a_run_ends_with_its_certificate(tmp_path, monkeypatch):
    handlers, before = [], signal.getsignal(signal.SIGTERM)

    def run(*_, **__):
        handlers.extend(signal.getsignal(number) for number in end_signals())

    monkeypatch.setattr(layouts.subprocess, "run", run)
    layouts.run_in_layout(tmp_path, 1, layouts.ALONE, tmp_path / "run.mcap")
    assert set(handlers) == {signal.default_int_handler}
    assert signal.getsignal(signal.SIGTERM) == before


def test_a_world_is_certified_in_all_layouts(world, tmp_path):
    path, page = world("kept_garden"), tmp_path / "page.html"
    words = ["certify", str(path), "--json", "--processes", "5", "--report", str(page)]
    words += ["--frames", "10"]
    words += ["--python", sys.executable, "--python", "no-such-interpreter"]
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus", *words],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    made = json.loads(done.stdout)
    assert made["certified"]
    results = [check["result"] for check in made["checks"]]
    assert results == [SAME] * 13 + [LEFT_OUT]
    assert len({check["digest"] for check in made["checks"] if check["digest"]}) == 1
    assert made["checks"][-1]["lines"] == ["no-such-interpreter: No such file or directory"]
    killed = [line for check in made["checks"] for line in check["lines"] if "killed: " in line]
    assert killed[0].startswith("killed: coordinator")
    text = page.read_text(encoding="utf-8")
    assert text.count("<tr>") == 1 + len(results)
    assert made["verdict"] in text
    assert made["verdict"].endswith(f"; 10 of the 12 frames of {path}")
    # What no run has called may still differ in a later one.
    assert [each["code"] for each in made["suspects"][str(path)]] == ["time.time()"]
    assert "lines that can make other runs differ" in text


def test_a_processor_that_cannot_be_emulated_is_refused(tmp_path):
    with pytest.raises(MisuseError, match="expected one of: aarch64"):
        emulated("sparc", tmp_path)
    with pytest.raises(MisuseError, match="need each other"):
        interpreters([], "aarch64", None)
    (tmp_path / "bin").mkdir()
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PATH", str(tmp_path / "bin"))
        with pytest.raises(MisuseError, match="apt install qemu-user-static"):
            emulated("aarch64", tmp_path)
        (qemu := tmp_path / "bin" / "qemu-aarch64").write_text("")
        qemu.chmod(0o755)
        with pytest.raises(MisuseError, match="remove the folder"):
            emulated("aarch64", tmp_path)


@pytest.mark.slow  # A minute of downloads, half a minute of emulation.
@pytest.mark.skipif(not shutil.which("qemu-aarch64-static"), reason="qemu-user is not installed")
def test_a_world_is_the_same_on_another_processor(world, tmp_path):
    pythons = interpreters([], "aarch64", tmp_path / "arm")
    made = certify([str(world("distant_garden"))], plan(frames=3, pythons=pythons))
    assert (made.checks[-1].name, made.checks[-1].result) == ("emulated aarch64", SAME)


@pytest.mark.skipif(
    not (ARM and shutil.which("qemu-aarch64-static")),
    reason="it needs qemu-user-static, and a folder of `certify --setup` in MINERVA_ARM",
)
def test_meadow_has_the_same_digest_on_another_processor():
    # The code of this project, not that of the folder, with the libraries of the folder.
    own = [path for path in sys.path if Path(path).is_relative_to(ROOT) and ".venv" not in path]
    command = [
        part.replace("PYTHONPATH=", f"PYTHONPATH={os.pathsep.join([str(ROOT), *own])}{os.pathsep}")
        for part in emulated("aarch64", Path(ARM))
    ]
    words = ["-m", "minerva_bus", "run", "meadow", "--in-process", "--frames", "3", "--json"]
    runs = [
        subprocess.run([*python, *words], capture_output=True, text=True, check=True)
        for python in (command, [sys.executable])
    ]
    arm, here = (json.loads(run.stdout)["digest"] for run in runs)
    assert arm == here


def test_a_death_loses_state_that_is_not_saved(world):
    changed = [
        (str(position), when, frame)
        for position, when, frame in deaths(read_world_file(world("lost_garden", "")), range(4))
        if frame is not None
    ]
    assert ("TickRequest to sun in frame 2", "before", 2) in changed
    assert all(" to sun " in position for position, _, _ in changed)
    file = read_world_file(world("saved_garden"))
    found = list(deaths(file, range(4)))
    assert {when for _, when, _ in found} == {*WHEN}
    assert not [changed for _, _, changed in found if changed is not None]


def test_a_terminal_shows_the_check_that_runs(monkeypatch, capsys):
    screen = io.StringIO()
    screen.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", screen)
    rows = CheckRows(as_json=False)
    rows.begun("pond", 2, 8, APART.name)
    assert screen.getvalue().endswith(f"  2/8 {APART.name}")
    rows(Check("pond", APART.name, SAME, 12))
    assert screen.getvalue().endswith("\r\x1b[2K")  # The row stands alone in its line.
    assert capsys.readouterr().out.splitlines()[1].startswith(f"{APART.name} ")


def test_without_time_and_without_a_run_it_is_no_certificate(world):
    path = world("late_garden")
    begun = []
    made = certify(
        [str(path)], plan(until=time.monotonic(), begun=lambda *what: begun.append(what))
    )
    assert {check.result for check in made.checks[1:]} == {NO_TIME}
    assert begun == [(str(path), 0, len(made.checks), ALONE.name)]
    assert not made.is_complete
    path.with_suffix(".py").write_text(path.with_suffix(".py").read_text() + "1 / 0\n")
    failing = certify([str(path)], plan())
    assert [check.result for check in failing.checks] in ([LEFT_OUT], [FAILS])
    assert not failing.is_complete
