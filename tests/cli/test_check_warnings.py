"""What `minerva check` warns about: rejected agents that repeat an action, idle statements."""

import json
import subprocess
import sys

import pytest

from minerva_bus import World, check

CODE = """\
from minerva_bus import Agent, Device, EventType, Primitive, Vocabulary, on, view

PDot = Primitive("PDot", size=float)
eStep = EventType("eStep")
eSee = EventType("eSee", visual=True)


class Cart(Agent, symbol="ACart"REST):
    x: float = 0.0
    action: float = 0.0

    @on("eStep")
    def go(self, step, moment):
        self.x += self.action

    @view("eSee")
    def picture(self, event):
        return PDot(size=self.action)


class Motor(Device, draws=("eSee",), coupled=COUPLED, when="each frame"):
    def show(self, shown):
        pass


vocabulary = Vocabulary.of(PDot, eStep, eSee, Cart)
"""
FILE = """\
[world]
string = "ACart#a"
vocabulary = "carts:vocabulary"

[process.carts]
agents = "carts:Cart"

[process.motor]
service = "carts:Motor"

[norm.nogo]
when = "x > 5"
THEN
"""


@pytest.mark.parametrize(
    ("rest", "coupled", "then", "warned"),
    [
        ("", "True", "", True),
        (", rest=('action',)", "True", "", False),
        ("", "False", "", False),
        ("", "True", "then = 'count'", False),
        ("", "True", "on = 'eStep'\napplies = 'ACart'", False),
    ],
)
def test_a_norm_on_agents_that_cannot_rest_is_warned_of(rest, coupled, then, warned, tmp_path):
    (tmp_path / "carts.py").write_text(CODE.replace("REST", rest).replace("COUPLED", coupled))
    text = FILE.replace("THEN", then)
    (tmp_path / "carts.toml").write_text(text)
    words = [sys.executable, "-m", "minerva_bus", "check", "carts.toml"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (
        done.stderr.startswith("warning: norm.nogo rejects steps of ACart, which motor") == warned
    )
    assert done.stderr.count("\n") == warned
    if warned:
        assert 'rest=("action",)' in done.stderr
        as_json = subprocess.run([*words, "--json"], cwd=tmp_path, capture_output=True, text=True)
        assert len(json.loads(as_json.stdout)["warnings"]) == 1


IDLE = """\
from minerva_bus import EMPTY, Agent, EventType, Generator, Primitive, on

PDot = Primitive("PDot", size=float)
eStep = EventType("eStep")


class Sheep(Agent, symbol="ASheep"):
    energy: float = 1.0
    births: int = 0

    @on("eStep")
    def live(self, step, moment):
        "A text is no mistake."
        if self.energy < 0:
            EMPTY  # did you forget return?
        self.energy == 3  # to assign, write =
        self.string + self.child()  # did you forget return?
        moment.emit  # call it
        eStep()  # moment.emit
        moment.emit(eStep())
        [moment.emit(each) for each in ()]
        EMPTY if self.energy < 0 else None  # did you forget return?

    def shown(self):
        PDot(size=1.0)  # did you forget return?
        Sheep("a")  # did you forget return?


class Steps(Generator, events=("eStep",)):
    def generate(self, tick):
        tick.random.random()
        eStep()  # did you forget return or yield?
        yield None


world = World("ASheep#a", agents=[Sheep], services=[Steps])
"""


def test_statements_without_effect_are_warned_of(tmp_path):
    path = tmp_path / "sheep.py"
    path.write_text(IDLE)
    names = {"World": World}
    with pytest.warns(UserWarning, match="has no effect") as warned:
        exec(compile(IDLE, str(path), "exec"), names)
    lines = enumerate(IDLE.splitlines(), 1)
    expected = [(f"{path}:{n}, in ", line.split("  # ")[1]) for n, line in lines if "  # " in line]
    warnings = check(names["world"]).warnings
    assert [str(each.message) for each in warned] == warnings
    for (place, hint), warning in zip(expected, warnings, strict=True):
        assert warning.startswith(place)
        assert hint in warning
