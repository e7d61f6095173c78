"""Parameters of the string as variables of sweeps, branches and searches, and as settings."""

import csv
import json
import subprocess
import sys

import pytest

pytest.importorskip("optuna", reason="pip install 'minerva-bus[optuna]'")

from typer.testing import CliRunner

from minerva_bus import Agent, MinervaError, World, branch, calibrate, each, on, run, sweep
from minerva_bus.cli.main import app
from minerva_bus.grammar.symbols import EventType
from tests.study.ponds import pond

eHour = EventType("eHour")


class Vine(Agent, symbol="AVine"):
    height: float = 0.0
    rate: float = 1.0
    buds: int = 1
    wild: bool = False
    name: str = "0"

    @on("eHour")
    def grow(self, hour, moment):
        self.height += self.rate * self.buds * (2 if self.wild else 1) + float(self.name)


WORLD = World(
    lambda options: Vine.many("v", 2), agents=[Vine], services=[each(eHour)], name="vines"
)
HEIGHTS = {"least": "min(AVine.height)", "most": "max(AVine.height)"}
GIVEN = {"frames": 2, "collect": HEIGHTS, "workers": 1, "quiet": True}


def off_targets(rows):
    """How far the last heights are from 3 and 8."""
    return abs(rows["least"][-1] - 3.0) + abs(rows["most"][-1] - 8.0)


@pytest.mark.parametrize("sampler", ["tpe", "nsga-ii", "random"])
def test_parameters_of_agents_are_searched_for(sampler):
    # Bounds of whole numbers are bounds of reals for a real parameter.
    ranges = {"#v0.rate": (0, 3), "#v1.buds": (1, 6), "AVine.wild": [False, True]}
    result = calibrate(WORLD, off_targets, ranges, trials=12, sampler=sampler, **GIVEN)
    assert result.trials.columns == (*ranges, "value")
    for rate, buds, wild, value in result.trials.rows():
        heights = sorted([2 * rate * (1 + wild), 2.0 * buds * (1 + wild)])
        assert value == pytest.approx(abs(heights[0] - 3) + abs(heights[1] - 8))
    assert any(rate != int(rate) for rate in result.trials["#v0.rate"])
    assert result.value == min(result.trials["value"])
    assert dict(result.best) == dict(zip(ranges, min(result.trials.rows(), key=lambda row: row[3])[:3], strict=True))  # fmt: skip


def test_texts_that_look_like_numbers_remain_texts():
    result = calibrate(WORLD, off_targets, {"AVine.name": ["0", "10"]}, trials=6, **GIVEN)
    assert set(result.trials.rows()) <= {("0", 7.0), ("10", 33.0)}
    assert result.best == {"AVine.name": "0"}


def test_sweeps_and_branches_vary_the_string(tmp_path):
    table = sweep(WORLD, {"AVine.rate": [1.0, 4.0]}, frames=2, collect=HEIGHTS, workers=1, quiet=True)  # fmt: skip
    last = table["frame"] == table["frame"].max()
    assert list(table["most"][last]) == [2.0, 8.0]
    world = pond(tmp_path)
    record = tmp_path / "pond.mcap"
    run(world, frames=4, record=record)
    sized = {"size": "max(ABud.size)"}
    given = {"frames": 5, "collect": sized, "workers": 1, "quiet": True}
    branches = branch(record, 4, {"#b.vigour": [0.0, 2.0]}, **given)
    still, grown = branches["size"][branches["frame"] == 5]
    # The frame's string, not the first one, gets the value.
    assert 1.4 < still < 2.0 < grown - still < 2.3
    with pytest.raises(MinervaError, match="no agent #c"):
        branch(record, 4, {"#c.vigour": [0.0]}, **given)


def test_a_setting_of_the_best_trial_repeats_its_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["calibrate", str(pond(tmp_path)), "--range", "ABud.vigour=0:1",
             "--range", "PStone.size=1,2", "--objective", "pond_of_buds:far_from_two",
             "--trials", "8", "--sampler", "nsga-ii", "--collect", "size=mean(ABud.size)",
             "--workers", "1", "--json"]  # fmt: skip
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    rows = list(csv.DictReader((tmp_path / answer["table"]).open()))
    best = min(rows, key=lambda row: float(row["value"]))
    assert {key: float(best[key]) for key in answer["best"]} == answer["best"]
    lines = (tmp_path / "pond-trials.csv.runs" / "runs.journal").read_text().splitlines()
    of_best = next(line for line in map(json.loads, lines[1:])
                   if line["set"][0] == str(answer["best"]["ABud.vigour"]))  # fmt: skip
    # On the bus, where other processes read the world file, too. A command of its own: this process
    # may have used Zenoh, whose threads do not survive a fork.
    again = ["run", str(tmp_path / "pond.toml"), "--json", "--set", "ABud.vigour=" + best["ABud.vigour"],
             "--set", f"PStone.size={best['PStone.size']}"]  # fmt: skip
    ran = subprocess.run(
        [sys.executable, "-m", "minerva_bus", *again], capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["digest"] == of_best["outcome"]["digest"]


@pytest.mark.parametrize(
    ("ranges", "more", "says"),
    [
        ({"#v2.rate": (0.0, 1.0)}, {}, "no agent #v2"),
        ({"AVin.rate": (0.0, 1.0)}, {}, "no AVin; did you mean 'AVine'"),
        ({"AVine.rat": (0.0, 1.0)}, {}, "no 'rat'; did you mean 'rate'"),
        ({"AVine.buds": (0.5, 2.0)}, {}, "expected a whole number"),
        ({"AVine.rate": (2.0, 1.0)}, {}, "expected bounds such as"),
        ({"AVine.rate": "2:2"}, {}, "expected bounds such as"),
        ({"AVine.wild": (0, 1)}, {}, "a bool has no bounds"),
        ({"AVine.wild": ["maybe"]}, {}, "AVine.wild=maybe: expected"),
        ({"AVine.rate": (0.0, 1.0)}, {"sampler": "nsgaii"}, "did you mean 'nsga-ii'"),
    ],
)
def test_mistakes_are_explained(ranges, more, says):
    with pytest.raises(MinervaError, match=says):
        calibrate(WORLD, off_targets, ranges, trials=1, **GIVEN, **more)


def test_a_resumed_run_takes_no_values_of_the_string(tmp_path):
    world, record = pond(tmp_path), tmp_path / "pond.mcap"
    run(world, frames=2, record=record)
    words = ["run", str(world), "--resume", str(record), "--set", "ABud.vigour=1"]
    failed = CliRunner().invoke(app, words)
    assert "a resumed run continues with its own string" in str(failed.exception)
