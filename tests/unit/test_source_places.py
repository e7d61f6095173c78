"""The line of user code that an error or a stack is reported at."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from minerva_bus.errors import StateError, UserCodeError
from minerva_bus.launch.child_processes import blocked_at
from minerva_bus.launch.world_files import idle
from minerva_bus.user_code import SourceLine, defined, innermost, place_of, report


@dataclass(frozen=True)
class Box:
    size: float
    content: object = field(default=None, kw_only=True)


def shrinks(box):
    box.size = 0.5


def test_a_generated_method_is_not_the_place_of_an_error():
    try:
        shrinks(Box(1.0))
    except AttributeError as error:
        place = place_of(error)
    assert (Path(place.file).name, place.function) == ("test_source_places.py", "shrinks")
    assert place.shown[0] == "box.size = 0.5"


def test_generated_code_is_not_the_place_of_a_stack():
    compiler = SourceLine("<string>", 1, "<module>")
    caller = SourceLine(__file__, 20, "shrinks")
    assert innermost([compiler, caller]).function == "shrinks"
    assert innermost([compiler]).file == "<string>"


def written(*files, cut=False):
    """Stacks as the fault handler writes them: of another thread, then of the main thread."""
    lines = [f'  File "{file}", line 2 in call' for file in files]
    return [
        "Thread 0x01 (most recent call first):",
        '  File "/other/thread.py", line 1 in waits',
        *(["  ..."] if not cut else []),
        "Current thread 0x02 (most recent call first):",
        *lines,
        *(["  ..."] if cut else []),
    ]


def test_a_package_is_the_place_of_a_stack_only_if_the_stack_is_complete():
    """The fault handler writes 100 calls, and imports of a package are deeper."""
    package, launcher = np.__file__, "/launcher.py"
    assert blocked_at(written(package, launcher), launcher).file == package
    assert blocked_at(written(package, cut=True), launcher) is None
    assert blocked_at(written(package, __file__, cut=True), launcher).file == __file__
    assert blocked_at(written(package, launcher, __file__), launcher).file == package


@pytest.mark.parametrize("folder", ["/home/ann/.local/lib/python3.9/site", "/usr/lib/python3/dist"])
def test_a_library_that_another_python_has_is_not_the_place_of_a_stack(folder):
    library = SourceLine(f"{folder}-packages/numba/compiler.py", 1, "compiles")
    assert innermost([library, SourceLine(__file__, 20, "shrinks")]).file == __file__
    assert innermost([library]) == library
    own = SourceLine("/home/ann/ros-packages/world.py", 1, "moves")
    assert innermost([library, own]) == own


# --- code without a file: cells, `python -c`, `exec` ---

SNAIL = """
from minerva_bus import Agent, EventType, Vocabulary, evolve, on

eTick = EventType("eTick")

class Snail(Agent, symbol="ASnail"):
    @on("eTick")
    def dry(self, tick, moment):
        self.water = 1 / 0

string = Vocabulary.of(eTick, Snail).read("ASnail#a")
evolve(string, [eTick()], [Snail])
"""


def executed(file):
    """The error of a snail whose code is compiled as this file, without the frame of this test."""
    try:
        exec(compile(SNAIL, file, "exec"), {"__name__": "__main__"})
    except UserCodeError as error:
        return error.__cause__
    raise AssertionError("it did not fail")


def test_the_place_in_a_cell_of_a_notebook_is_its_number(monkeypatch):
    compiler = pytest.importorskip("IPython.core.compilerop").CachingCompiler()
    shell = SimpleNamespace(compile=compiler)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    place = place_of(executed(compiler.cache(SNAIL, 7)))
    assert place.lines()[:2] == ["  Cell In[7], line 9, in Snail.dry", "    self.water = 1 / 0"]
    assert SourceLine("snail.py", 3).where == "snail.py:3"
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: None))
    assert place.where == f"{place.file}:9"


def test_code_in_a_file_that_is_no_python_has_no_source(tmp_path):
    page = tmp_path / "page.md"
    page.write_text('Write `[` and """:\n' * 20)
    names = {"__name__": "__main__"}
    exec(compile(SNAIL.rpartition("evolve")[0], page, "exec"), names)
    assert not idle(names["Snail"])
    assert defined(names["Snail"].dry).where == f"{page}:7"


def test_a_program_on_the_command_line_has_a_source_line(monkeypatch):
    monkeypatch.setattr(sys, "orig_argv", ["python", "-c", SNAIL])
    assert place_of(executed("<string>")).lines() == [
        "  <string>:9, in Snail.dry", "    self.water = 1 / 0",
    ]  # fmt: skip
    monkeypatch.setattr(sys, "orig_argv", ["python", "-c", f"exec({SNAIL!r})"])
    assert place_of(executed("<string>")).lines() == ["  <string>:9, in Snail.dry"]


def test_each_line_that_sets_a_wrong_attribute_may_be_the_cause():
    def dry(self):
        self.water = 1.0
        if self.water < 0:
            self.water /= 2

    error = UserCodeError("dry", dry)
    error.__cause__ = StateError("water must be a finite number, not nan", "water")
    first = dry.__code__.co_firstlineno + 1
    assert report(error).split("\n") == [
        "dry: water must be a finite number, not nan",
        f"  {__file__}:{first}, in dry: set in line {first} or {first + 2}",
        "    self.water = 1.0",
        "    self.water /= 2",
    ]
