"""`[world] compiled`, `minerva run --compiled`, and hosts that share compiled methods."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys

import pytest

pytest.importorskip("numba")

from minerva_bus import run
from minerva_bus.errors import WorldFileError
from minerva_bus.launch import process_specs
from minerva_bus.launch.installed import find_world
from minerva_bus.launch.world_files import read_world_file
from minerva_bus.settings.world_settings import Overrides

MODULE = """
import numpy as np
from minerva_bus import EMPTY, Agent, Disc, EventType, Generator, Metres, Motion
from minerva_bus import Primitive, Transformation, Vocabulary, on, view

eDay = EventType("eDay", grass=float)
ePicture = EventType("ePicture", visual=True)
TAt = Transformation("TAt", Motion(x="x"), x=Metres)
PSpot = Primitive("PSpot", Disc("size"), size=Metres)
eCall = EventType("eCall", loud=float)


class Sheep(Agent, symbol="ASheep"):
    x: float = 0.0
    energy: float = 5.0
    friend: str = "s1"
    births: int = 0

    @on("eDay")
    def live(self, day, moment):
        self.x += moment.chance.normal(0, 0.5)
        self.energy += day.grass * moment.chance.random() - 1
        if self.x > 1:
            moment.emit(eCall(loud=self.x, receivers=[self.friend]))
        if self.energy < 0:
            return EMPTY
        if self.energy > 8:
            self.energy /= 2
            return self.string + self.child(x=self.x, energy=self.energy, friend=self.id)

    @on("eCall")
    def answer(self, call, moment):
        self.energy += 0.01 * call.loud
        self.friend = call.sender

    @view("ePicture")
    def picture(self, picture):
        return TAt(self.x)(PSpot(0.1 * self.energy))


class Odd(Agent, symbol="AOdd"):
    n: int = 0

    @on("eDay")
    def live(self, day, moment):
        self.n = len([1, 2])

    @view("ePicture")
    def picture(self, picture):
        return self.string


vocabulary = Vocabulary.of(eDay, eCall, ePicture, TAt, PSpot, Sheep, Odd)


class Days(Generator, events=("eDay",)):
    def generate(self, tick):
        yield eDay(grass=2.0)


def flock(options):
    return Sheep.many("s", 300, x=np.linspace(0, 9, 300)) + Odd.many("o", 40)
"""
WORLD = """
[world]
scene = "compiled_pasture:flock"
vocabulary = "compiled_pasture:vocabulary"
seed = 7
frames = 6
{compiled}

[process.days]
service = "compiled_pasture:Days"

[process.sheep]
agents = "compiled_pasture:Sheep"
processes = {hosts}
"""


@pytest.fixture
def world(tmp_path, monkeypatch):
    """A function that writes the world with a setting and number of hosts, and returns its path."""
    (tmp_path / "compiled_pasture.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.delitem(sys.modules, "compiled_pasture", raising=False)
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(compiled="", hosts=1, more=""):
        # The name of the file is that of the world, which another run of the tests may also have.
        path = tmp_path / f"compiled-pasture-{os.getpid()}.toml"
        path.write_text(WORLD.format(compiled=compiled, hosts=hosts) + more, encoding="utf-8")
        return path

    return write


def digest(path, *words):
    """The digest of a run in a new process, and what it printed."""
    done = subprocess.run(
        [sys.executable, "-m", "minerva_bus", "run", str(path), "--json", *words],
        capture_output=True, text=True, cwd=path.parent, env=os.environ, check=False,
    )  # fmt: skip
    assert not done.returncode, done.stderr
    return json.loads(done.stdout)["digest"], done.stderr


def test_hosts_with_compiled_methods_give_the_digest_of_the_methods(world):
    plain, _ = digest(world(hosts=2), "--in-process")
    assert digest(world(hosts=2), "--compiled")[0] == plain
    assert digest(world("compiled = true", hosts=3))[0] == plain


def test_a_method_that_cannot_be_compiled_is_an_error_of_the_world_file(world):
    more = '[process.odd]\nagents = "compiled_pasture:Odd"\n'
    with pytest.raises(WorldFileError) as raised:
        read_world_file(world("compiled = true", more=more))
    message = str(raised.value)
    assert "[world] compiled = true: Odd.live cannot be compiled" in message
    assert "compiled_pasture.py:" in message
    assert 'compiled = "if possible"' in message


def test_if_possible_reports_what_it_did(world):
    more = '[process.odd]\nagents = "compiled_pasture:Odd"\n'
    file = read_world_file(world('compiled = "if possible"', more=more))
    assert file.notes[0] == "compiled 2 methods of agents"
    assert file.notes[1].startswith("not compiled: Odd.live cannot be compiled: ")
    # The setting is that of a world: the same classes in another one are not compiled.
    file = read_world_file(world(more=more))
    classes = [cls for process in file.processes for cls in process.agents]
    assert [cls.accelerator for cls in classes] == [None, None]


def test_if_possible_compiles_nothing_for_agents_too_few_to_be_columns(world, monkeypatch):
    monkeypatch.setattr(process_specs, "MANY", 41)
    more = '[process.odd]\nagents = "compiled_pasture:Odd"\n'
    file = read_world_file(world('compiled = "if possible"', more=more))
    counted = "compiled 2 methods of agents"
    assert file.notes[:2] == (counted, "not compiled: Odd, fewer than 41 agents")


GALLERY = {
    "flock": {"birds": "80"},
    "slime": {"cells": "400", "width": "60", "height": "40"},
    "traffic": {"cars": "40"},
}


@pytest.mark.parametrize(("name", "options"), GALLERY.items())
def test_worlds_of_the_gallery_say_what_is_compiled_and_keep_their_digest(name, options):
    notes = read_world_file(find_world(name), Overrides(options=options)).notes
    said = re.compile(r"compiled [1-9] methods? of agents")
    assert any(map(said.fullmatch, notes))
    given = [word for key, value in options.items() for word in (f"--{key}", value)]
    words = ["--in-process", "--rate", "0", "--frames", "8", *given]
    compiled, plain = (
        digest(find_world(name), *words, *more)[0] for more in ([], ["--no-compiled"])
    )
    assert compiled == plain


def test_another_value_is_an_error(world):
    with pytest.raises(WorldFileError, match="compiled must be true, false or if possible"):
        read_world_file(world('compiled = "maybe"'))


def test_the_command_line_does_not_import_numba():
    code = (
        "import sys, minerva_bus.cli.main, minerva_bus.world.agent; print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("methods", ["", "    @on('eStep', compiled=True)\n{}"])
def test_only_a_class_with_compiled_methods_imports_the_extension(tmp_path, methods):
    body = methods.format("    def walk(self, step, moment):\n        self.x = 1.0\n")
    (tmp_path / "walker.py").write_text(
        "from minerva_bus import *\n"
        f"class Walker(Agent, symbol='AWalker'):\n    x: float = 0.0\n{body}"
    )
    code = "import sys, minerva_bus.launch.supervisor, walker; print('minerva_fast' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str(bool(methods))


def test_without_numba_the_error_names_the_extra(world, monkeypatch):
    from minerva_fast import machine_code

    monkeypatch.setitem(sys.modules, "numba", None)
    machine_code.load_kernel.cache_clear()
    file = read_world_file(world('compiled = "if possible"'))
    assert "runs agent by agent, without numba: " in file.notes[-1]
    with pytest.raises(Exception, match=r"minerva-bus\[fast\]"):
        run(str(world("compiled = true")), bus=False)
