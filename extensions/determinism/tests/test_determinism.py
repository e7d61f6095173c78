"""`minerva determinism` names the first frame, agent and attribute that differ."""

import errno
import json
import os
import subprocess
import sys
from dataclasses import asdict

import pytest

from minerva_bus import World
from minerva_determinism import layouts

pytest.importorskip("mcap")

CODE = """\
import datetime
import random
import time

from minerva_bus import (
    Agent, Device, EventType, Generator, Primitive, Vocabulary, on, view,
)

PDot = Primitive("PDot", size=float)
eSun = EventType("eSun", light=float)
eWind = EventType("eWind")
ePicture = EventType("ePicture", visual=True)
counted = []


class Plant(Agent, symbol="APlant"):
    height: float = 0.0
    light_seen: float = 0.0
    count: int = 0
    time: float = 0.0
    date: str = ""
    chance: float = 0.0
    hash: int = 0
    order: str = ""

    @on("eSun")
    def grow(self, sun, moment):
        self.height += moment.random.random()
        self.light_seen = sun.light
        if moment.number >= 2:
            WHEN

    @on("eWind")
    def bend(self, wind, moment):
        self.height = 0.0

    @view("ePicture")
    def picture(self, event):
        return PDot(size=self.height)


class Sun(Generator, events=("eSun",)):
    def generate(self, tick):
        yield eSun(light=LIGHT)


class Wind(Generator, events=("eWind",), when="freely"):
    def run(self, emit, stop):
        while not stop.wait(0.001):
            emit(eWind())


class Motor(Generator, events=("eWind",)):
    outside = "a motor"

    def generate(self, tick):
        raise RuntimeError("a check starts no motor")


class Watch(Device, draws=("ePicture",), when="each frame"):
    def show(self, shown):
        raise RuntimeError("a check shows nothing")


vocabulary = Vocabulary.of(PDot, eSun, eWind, ePicture, Plant)
"""

FILE = """\
[world]
string = "APlant#a · APlant#b · APlant#c · APlant#d"
vocabulary = "garden:vocabulary"
frames = 6

[process.plants]
agents = "garden:Plant"

[process.sun]
service = "garden:Sun"
"""
FREE = """
[process.wind]
service = "garden:Wind"

[process.motor]
service = "garden:Motor"

[process.watch]
service = "garden:Watch"
"""


def check(folder, *words, when="pass", light="1.0", file=FILE):
    """Exit code, output and errors for a world with `when` and `light` inserted into its code."""
    code = CODE.replace("WHEN", when).replace("LIGHT", light)
    (folder / "garden.py").write_text(code)
    (folder / "garden.toml").write_text(file)
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus", "determinism", "garden.toml", *words],
        cwd=folder, env={**os.environ, "MINERVA_RUNTIME_DIR": str(folder / "runtime")},
        capture_output=True, text=True,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def test_a_valid_world_reads_the_same_and_skipped_checks_are_named(tmp_path):
    late = "self.height += time.time() if moment.number >= 4 else 0.0"
    code, out, error = check(tmp_path, "--frames", "4", when=late, file=FILE + FREE)
    assert (code, error) == (0, "")
    assert out.startswith(
        "garden.toml: the same in both runs: 4 frames\n"
        "not compared: wind (it runs freely)\n"
        "not compared: motor (it needs a motor)\n"
        "not compared: watch (it only shows views)\n"
        "lines that can make other runs differ, and what to use instead:\n"
    )
    assert ": time.time()\n" in out
    assert {path.name for path in tmp_path.iterdir()} <= {
        "garden.py", "garden.toml", "__pycache__",
    }  # fmt: skip


EACH = """
            counted.append(self.id)
            self.count = len(counted)
            if self.id == "a":
                self.time = time.time()
                self.date = str(datetime.date.today())
                self.chance = random.random()
                self.hash = hash("sun") % 1000
                self.order = list({"left", "right"})[0]
"""


def test_differences_are_named(tmp_path):
    code, out, error = check(tmp_path, "--json", when=EACH.strip())
    assert (code, error) == (1, "")
    answer = json.loads(out)
    assert (answer["ok"], answer["same"], answer["frame"]) == (False, False, 2)
    changes = {(change["agent"], change["attribute"]) for change in answer["changes"]}
    attributes = ("time", "date", "chance", "hash", "order")
    assert changes >= {("APlant#a", attribute) for attribute in attributes}
    assert "count" in {attribute for _, attribute in changes}
    suspected = {each["code"] for each in answer["suspects"]}
    assert suspected >= {"counted.append(self.id)", "random.random()", "hash('sun')"}


def test_people_read_where_and_what_to_use_instead(tmp_path):
    code, out, error = check(tmp_path, light="time.time()")
    assert (code, out) == (1, "")
    for word in ("frame 0 is the first that differs", "events of A alone", "eSun", "APlant#a",
                 "light_seen", "A: one process for all members", "moment.time", "garden.py:44: time.time()"):  # fmt: skip
        assert word in error
    assert len(error.splitlines()) <= 25


def test_bad_input_and_a_difference_have_different_exit_codes(tmp_path):
    code, _, error = check(tmp_path, file=FILE.replace("garden:Sun", "garden:Son"))
    assert code == 2
    assert "Son" in error
    assert "Traceback" not in error


def test_a_failing_world_reports_its_error(tmp_path):
    code, _, error = check(tmp_path, when="1 / 0")
    assert code == 1
    assert "garden.toml: it fails in one process for all members:" in error
    assert "ZeroDivisionError" in error
    assert "Traceback" not in error


def test_a_full_disk_is_one_line(tmp_path, monkeypatch, capsys):
    def fail(*given, **options):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # Without a name, as for a write.

    monkeypatch.setattr(layouts, "run_world", fail)
    record = tmp_path / "run.mcap"
    layout = json.dumps(asdict(layouts.ALONE))
    monkeypatch.setattr(sys, "argv", ["layouts", *map(str, ("meadow", 1, layout, record))])
    monkeypatch.setattr(layouts, "read_world_file", lambda path: World.load(str(path)).read())
    with pytest.raises(SystemExit) as ended:
        layouts.main()
    assert (ended.value.code, capsys.readouterr().err) == (
        2, f"{record}: No space left on device\n",
    )  # fmt: skip
