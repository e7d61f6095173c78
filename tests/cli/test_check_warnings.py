"""`minerva check` warns about norms whose rejected agents would repeat the same action."""

import json
import subprocess
import sys

import pytest

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
