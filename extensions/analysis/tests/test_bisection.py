"""Why two runs part: faults are put into a world, and a bisection names their methods and lines."""

import json
import sys

import pytest

from tests.runtime.running import here

pytest.importorskip("mcap", reason="pip install 'minerva-bus[record]'")

FRAMES = 24
WORLD = """
[world]
name = "mill"
seed = 5
frames = 24
vocabulary = "mill:vocabulary"
string = "AMiller#m · AMiller#n<stock=3> · AMouse#a"

[process.weather]
service = "mill:Weather"

[process.village]
agents = ["mill:Miller", "mill:Mouse"]
"""
MILL = """
from minerva_bus import Agent, EventType, Generator, Vocabulary, on

eWind = EventType("eWind", force=float)
eGrain = EventType("eGrain", weight=float)
TABLE = {"light": 1.0, "strong": 2.0}


def milled(force):
    return force * TABLE["strong"]


class Weather(Generator, events=("eWind",)):
    def generate(self, tick):
        force = tick.random.random()
        if tick.number % 2 == 0:
            return eWind(force), eWind(1.0)
        return eWind(force)


class Miller(Agent, symbol="AMiller"):
    stock: float = 10.0
    luck: float = 0.0
    born: int = 0

    @on("eWind")
    def grind(self, wind, moment):
        self.stock -= milled(wind.force)
        if moment.random.random() < 0.5:
            moment.emit(eGrain(weight=wind.force))

    @on("eGrain")
    def fill(self, grain, moment):
        self.stock += grain.weight
        self.luck = moment.random.random()


class Mouse(Agent, symbol="AMouse"):
    eaten: float = 0.0
    births: int = 0

    @on("eGrain")
    def eat(self, grain, moment):
        self.eaten += grain.weight
        if moment.number == 11:
            return self.string + self.child(eaten=0.0)


vocabulary = Vocabulary.of(Miller, Mouse, eWind, eGrain)
"""


def write_mill(folder, *changes, seed=5, name="mill"):
    """A world in a folder of its own, with its record; `changes` are pairs of old and new text."""
    folder.mkdir()
    code = MILL
    for old, new in changes:
        assert old in code
        code = code.replace(old, new)
    (folder / "mill.py").write_text(code)
    world = WORLD.replace('name = "mill"', f'name = "{name}"')
    (folder / "mill.toml").write_text(world.replace("seed = 5", f"seed = {seed}"))
    sys.modules.pop("mill", None)
    done = here(folder, "run", "mill.toml", "--in-process", "--rate", 0, "--record", "run.mcap")
    assert not done.returncode, done.stderr
    return folder / "run.mcap"


@pytest.fixture(scope="module")
def mill(tmp_path_factory):
    return write_mill(tmp_path_factory.mktemp("bisected") / "a")


def bisected(*words):
    done = here(words[0].parent, "bisect", *words, "--json")
    return done.returncode, json.loads(done.stdout)


# What is changed, from frame F on; the beginning of the cause, and the function that is named.
FAULTS = {
    "state": ("self.stock -= ", "self.stock -= (moment.number == F) + ", "stock of AMiller#m in frame F", "mill.Miller.grind"),
    "no change": ("self.eaten += grain.weight", "self.eaten += grain.weight * (moment.number < F)", "eaten of AMouse#a in frame ", "mill.Mouse.eat"),
    "helper": ("return force * TABLE", "return (force == 1) / 8 + force * TABLE", "stock of AMiller#m in frame 0", "mill.milled"),
    "constant": ('"strong": 2.0', '"strong": 2.5', "stock of AMiller#m in frame 0", "mill"),
    "event": ("weight=wind.force", "weight=wind.force + (moment.number == F)", "the events that #", "mill.Miller.grind"),
    "no event": ("moment.random.random() < 0.5", "moment.random.random() < 0.5 * (moment.number < F)", "the events that #", "mill.Miller.grind"),
    "order": ("if moment.random", "if moment.number == F: moment.emit(eGrain(weight=0.0))\n        if moment.random", "the events that #m sent in frame F", "mill.Miller.grind"),
    "random stream": ("self.luck = ", "moment.number < F or moment.random.random()\n        self.luck = ", "luck of AMiller#", "mill.Miller.fill"),
    "generator": ("return eWind(force)\n", "return eWind(force + (tick.number == F))\n", "the events of weather for frame F", "mill.Weather.generate"),
    "generator's stream": ("force = tick", "tick.number == F and tick.random.random()\n        force = tick", "the events of weather for frame F", "mill.Weather.generate"),
    "birth": ("moment.number == 11", "moment.number == 12", "births of AMouse#a in frame 11", "mill.Mouse.eat"),
    "child": ("eaten=0.0)", "eaten=1.0)", "eaten of AMouse#", "mill.Mouse.eat"),
}  # fmt: skip
KNOWN = (7,)


@pytest.mark.parametrize("frame", KNOWN)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found_with_its_function(mill, tmp_path, fault, frame):
    old, new, cause, function = (each.replace("F", str(frame)) for each in FAULTS[fault])
    other = write_mill(tmp_path / "b", (old, new))
    code, parting = bisected(mill, other)
    assert code == 1
    assert parting["cause"].startswith(cause), parting
    assert [each["function"] for each in parting["functions"]] == [function], parting


def test_the_code_of_today_runs_again_on_the_inputs_of_a_record(tmp_path):
    path = write_mill(tmp_path / "a")
    code, parting = bisected(path)
    assert code == 0, parting
    assert (parting["same"], parting["frames"]) == (True, FRAMES)
    text = (path.parent / "mill.py").read_text()
    (path.parent / "mill.py").write_text(text.replace("force = tick", "force = 0.5 * tick"))
    sys.modules.pop("mill", None)
    code, parting = bisected(path)
    assert code == 1
    assert parting["cause"] == "the events of weather for frame 0"
    (path.parent / "mill.py").write_text(text.replace("self.luck = ", "self.luck = 2.0 * "))
    sys.modules.pop("mill", None)
    code, parting = bisected(path)
    assert parting["cause"].startswith("luck of AMiller#")
    assert ", as in today's code: it has changed" in parting["remark"]


def test_code_that_computes_something_else_each_time_is_named(tmp_path):
    clock = ("self.luck = ", "import time; self.luck = time.perf_counter() + ")
    records = [write_mill(tmp_path / name, clock) for name in "ab"]
    code, parting = bisected(*records)
    assert code == 1
    assert parting["cause"].startswith("luck of AMiller#")
    assert parting["remark"].startswith("the code is not deterministic: from the same inputs")


def test_runs_that_begin_differently_say_nothing_of_the_code(mill, tmp_path):
    other = write_mill(tmp_path / "b", seed=6)
    code, parting = bisected(mill, other)
    assert code == 1
    assert parting["before"] == ["seed 5 in A, 6 in B"]
    assert parting["remark"] == "the runs begin differently: seed 5 in A, 6 in B"


def test_records_of_two_worlds_are_not_compared(mill, tmp_path):
    renamed = write_mill(tmp_path / "b", name="watermill")
    code, parting = bisected(mill, renamed)
    assert (code, parting["before"]) == (0, ["name mill in A, watermill in B"])
    other = write_mill(tmp_path / "c", ("eGrain", "eFlour"), name="bakery")
    code, answer = bisected(mill, other)
    assert code == 2
    assert "the record of another world, 'bakery', not of 'mill'" in answer["error"]


def test_code_that_fails_when_it_runs_again_is_reported(tmp_path):
    records = [
        write_mill(tmp_path / name, ("self.luck = ", f"self.luck = {name} * ")) for name in "12"
    ]
    for path in records:
        text = (path.parent / "mill.py").read_text()
        (path.parent / "mill.py").write_text(text.replace("self.luck = ", "self.luck = 1 / 0 + "))
    done = here(records[0].parent, "bisect", *records)
    assert done.returncode == 1, done.stderr
    assert "mill.py:35" in done.stderr
    assert len(done.stderr.splitlines()) <= 10
    assert "Traceback" not in done.stderr
