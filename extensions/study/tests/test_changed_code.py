"""A study does not continue with results of other code."""

import signal
import subprocess
import sys
import time

import pytest

from extensions.study.tests.ponds import pond
from minerva_bus import Agent, EventType
from minerva_study.code_digests import code_digests

eTick = EventType("eTick")
RATE = 1
TABLE = {"a": [1, 2]}


def sweep(world, *words):
    return subprocess.run(
        [sys.executable, "-m", "minerva_bus", "sweep", str(world), *words, "-o", "pond.csv",
         "--in-process"],
        cwd=world.parent, capture_output=True, text=True,
    )  # fmt: skip


def replace(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_sweep_of_changed_code_is_refused_and_named(tmp_path):
    world, module = pond(tmp_path), tmp_path / "pond_of_buds.py"
    assert sweep(world, "--set", "seed=0:2").returncode == 0
    replace(module, "eDay = EventType", "# One for each day.\neDay = EventType")
    replace(world, "frames = 5", "frames = 5  # days")
    more = sweep(world, "--set", "seed=0:3")
    assert more.returncode == 0, more.stderr
    assert "2 of 3 runs are in pond.csv.journal already" in more.stderr
    replace(module, "0.1 * moment", "0.2 * moment")
    refused = sweep(world, "--set", "seed=0:3")
    assert refused.returncode == 2
    assert "the code of pond_of_buds.Bud.grow; remove it to run all again" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
    replace(module, "0.2 * moment", "0.1 * moment")
    replace(world, "vigour = 0.1", "vigour = 0.2")
    refused = sweep(world, "--set", "seed=0:3")
    assert "different: the world's file; the world's string; remove it" in refused.stderr


SCRIPT = """
import os, sys
from minerva_bus import Agent, EventType, World, each, on
from minerva_study import sweep
eTick = EventType("eTick")
STEP = int(sys.argv[1])

class Snail(Agent, symbol="ASnail"):
    x: int = 0

    @on("eTick")
    def live(self, tick, moment):
        self.x += STEP + int(moment.chance.integers(3))

world = World("ASnail#s", agents=[Snail], services=[each(eTick)], name="snails")
table = sweep(world, seeds=int(sys.argv[2]), frames=20, collect=[Snail.x], folder="kept", workers=1)
print(table["x"].tolist())
"""


def script(folder, *words, start=False):
    (folder / "snails.py").write_text(SCRIPT)
    command = [sys.executable, "snails.py", *words]
    if start:
        return subprocess.Popen(command, cwd=folder)
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_a_script_that_was_killed_continues_unless_its_constants_change(tmp_path):
    (tmp_path / "whole").mkdir()
    whole = script(tmp_path / "whole", "1", "30")
    running = script(tmp_path, "1", "30", start=True)
    journal = tmp_path / "kept" / "runs.journal"
    while not journal.exists() or journal.read_bytes().count(b"\n") < 4:
        assert running.poll() is None
        time.sleep(0.005)
    running.send_signal(signal.SIGKILL)
    running.wait()
    again = script(tmp_path, "1", "30")
    assert "of 30 runs are in runs.journal already" in again.stderr
    assert again.stdout == whole.stdout
    changed = script(tmp_path, "2", "30")
    assert "the code of __main__.Snail.live" in changed.stderr


def helper():
    return RATE


class Base:
    def step(self):
        return helper()


class Snail(Agent, Base, symbol="ASnail"):
    x: float = 1.0

    def live(self):
        return self.step() + TABLE["a"][0]


def test_digests_reach_base_classes_functions_and_constants(monkeypatch):
    before = code_digests([Snail])
    here = f"{__name__}."
    assert {here + name for name in ("Snail", "Snail.live", "Base", "helper")} >= {*before}
    assert code_digests([Snail]) == before
    monkeypatch.setitem(TABLE, "a", [1, 3])
    assert code_digests([Snail])[f"{here}Snail"] != before[f"{here}Snail"]
    monkeypatch.undo()
    monkeypatch.setattr(f"{__name__}.RATE", 2)
    changed = code_digests([Snail])
    assert [name for name in before if changed[name] != before[name]] == [f"{here}helper"]
    monkeypatch.undo()
    assert code_digests([Snail]) == before


@pytest.mark.parametrize("value", [len, object(), lambda: 1])
def test_any_object_may_be_a_constant(value, monkeypatch):
    monkeypatch.setitem(TABLE, "b", value)
    assert code_digests([Snail]) == code_digests([Snail])


SNAILS = """
import os
from minerva_bus import Agent, EventType, World, each, on
from minerva_study import sweep
eTick = EventType("eTick")
COUNT = [0]

class Snail(Agent, symbol="ASnail"):
    pid: int = 0
    count: int = 0

    @on("eTick")
    def live(self, tick, moment):
        self.pid = os.getpid()
        self.count = {count}

world = World("ASnail#s", agents=[Snail], services=[each(eTick)], name="snails")
table = sweep(world, seeds=12, frames=1, collect=[Snail.pid, Snail.count], workers=2, quiet=True)
print(len(set(table["pid"][1::2].tolist())), sorted(set(table["count"][1::2].tolist())))
"""


@pytest.mark.parametrize(("count", "shown"), [
    ("COUNT[0] + 1", [1]),
    ("COUNT.append(1) or len(COUNT)", [2]),
    ("setattr(Snail, '_seen', getattr(Snail, '_seen', 0) + 1) or Snail._seen", [1]),
    ("int(__import__('random').random() > 2)", [0]),
])  # fmt: skip
def test_each_trial_has_a_process_of_its_own(tmp_path, count, shown):
    (tmp_path / "snails.py").write_text(SNAILS.replace("{count}", count))
    done = subprocess.run(
        [sys.executable, "snails.py"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.strip() == f"12 {shown}", done.stderr
