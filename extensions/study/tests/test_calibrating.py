"""`calibrate`: which options and parameters of the string are best, by Optuna over sweeps."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("optuna", reason="pip install 'minerva-bus[optuna]'")

from typer.testing import CliRunner

from extensions.study.tests.ponds import pond
from minerva_bus import Agent, MinervaError, World, each, on, run
from minerva_bus.cli.main import app
from minerva_bus.grammar.vocabulary import EventType
from minerva_study import branch, calibrate, sweep

eHour = EventType("eHour")
RANGES = {"rate": (0.0, 4.0), "soil": ["clay", "sand"], "weeks": (1, 3)}


class Shrub(Agent, symbol="AShrub"):
    height: float = 0.0
    rate: float = 1.0

    @on("eHour")
    def grow(self, hour, moment):
        self.height += self.rate


def shrubs(options):
    poor = options["soil"] == "sand"
    rate = options["rate"] / (2 if poor else 1) * options["weeks"]
    return Shrub.many("s", 1, rate=rate)


WORLD = World(
    shrubs, agents=[Shrub], services=[each(eHour)], name="shrubs",
    options={"rate": 1.0, "soil": "clay", "weeks": 1},
)  # fmt: skip


def off_target(rows):
    """How far the last height is from 6, in three frames."""
    return abs(rows["height"][-1] - 6.0)


def found(**arguments):
    given = {"trials": 20, "frames": 3, "collect": {"height": "mean(AShrub.height)"}, "workers": 1}
    return calibrate(WORLD, off_target, RANGES, quiet=True, **{**given, **arguments})


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A search whose runs are kept in a folder."""
    folder = tmp_path_factory.mktemp("calibrated")
    return found(folder=folder), folder


def test_the_best_trial_is_the_best_of_the_table(calibrated):
    result, _ = calibrated
    assert result.trials.columns == ("rate", "soil", "weeks", "value")
    assert len(result.trials) == 20
    values = result.trials["value"]
    assert result.value == values.min() < 1.0 < values.max()
    best = int(np.argmin(values))
    assert result.best == {key: result.trials[key][best] for key in RANGES}
    growth = result.best["rate"] * result.best["weeks"] / (1 + (result.best["soil"] == "sand"))
    assert result.value == pytest.approx(abs(3 * growth - 6.0))


def test_the_search_does_not_depend_on_workers(calibrated):
    trials = list(calibrated[0].trials.rows())
    assert list(found(workers=2, trials=10).trials.rows()) == trials[:10]
    assert list(found(seed=1, trials=4).trials.rows()) != trials[:4]


def test_finished_runs_are_not_repeated(calibrated):
    result, folder = calibrated
    lines = (folder / "runs.journal").read_text().splitlines()
    # An interrupted search: its last runs are missing.
    (folder / "runs.journal").write_text("\n".join(lines[:15]) + "\n")
    # A power cut: the rows of two finished runs are incomplete or missing.
    first, second = (next(iter(json.loads(line)["parts"])) for line in lines[1:3])
    (folder / first).write_bytes(b"")
    (folder / second).unlink()
    again = found(folder=folder)
    assert list(again.trials.rows()) == list(result.trials.rows())
    assert (folder / "runs.journal").read_text().splitlines()[:15] == lines[:15]


def test_a_column_of_outcomes_is_an_objective():
    given = {"trials": 2, "frames": 2, "workers": 1, "quiet": True}
    result = calibrate(WORLD, "frames", {"weeks": [1, 2]}, **given)
    assert result.value == 2.0


def test_trials_branch_from_a_frame_of_a_record(tmp_path):
    record = tmp_path / "run.mcap"
    run(WORLD, frames=4, record=record, seed=5)
    collect = {"height": "mean(AShrub.height)"}
    given = {"trials": 4, "frames": 6, "collect": collect, "workers": 1, "quiet": True}
    with pytest.raises(MinervaError, match="expected a record"):
        calibrate(WORLD, off_target, {"soil": ["clay"]}, frame=2, **given)
    bushes = pond(tmp_path)
    run(bushes, frames=5, record=tmp_path / "pond.mcap", seed=4)
    sized = {"size": "mean(ABud.size)"}
    again = {**given, "frames": 8, "collect": sized}
    result = calibrate(tmp_path / "pond.mcap", lambda rows: rows["seed"][0],
                       {"vigour": (0.1, 0.9)}, frame=3, seeds=2, **again)  # fmt: skip
    # The seeds begin with that of the record.
    assert set(result.trials["value"]) == {4.0}


def test_the_command_searches_and_continues(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bushes = pond(tmp_path)
    words = ["calibrate", str(bushes), "--range", "vigour=0.0:1.0", "--range", "wood=oak,elm",
             "--objective", "pond_of_buds:far_from_two", "--trials", "10",
             "--collect", "size=mean(ABud.size)", "--workers", "1", "--json"]  # fmt: skip
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert (answer["trials"], answer["failed"], answer["interrupted"]) == (10, 0, False)
    rows = list(csv.DictReader((tmp_path / answer["table"]).open()))
    best = min(rows, key=lambda row: float(row["value"]))
    assert {"vigour": float(best["vigour"]), "wood": best["wood"]} == answer["best"]
    assert float(best["value"]) == answer["value"] < 0.5
    # Nothing runs again; a trial with a failed run has no value, and the exit code is 1.
    again = CliRunner().invoke(app, [*words[:-1]])
    assert "10 trials are in pond-trials.csv" in again.stdout
    words[3] = "vigour=3.5,0.2"
    result = CliRunner().invoke(app, [*words, "-o", "some.csv"])
    assert (result.exit_code, json.loads(result.stdout)["best"]["vigour"]) == (1, 0.2)
    for wrong, says in (("vigour", "expected KEY=LOW:HIGH"), ("vigour=1:1", "expected bounds")):
        failed = CliRunner().invoke(app, [*words[:2], "--range", wrong, *words[6:]])
        assert says in str(failed.exception)


@pytest.mark.parametrize(
    ("ranges", "more", "says"),
    [
        ({"rate": (2.0, 1.0)}, {}, "expected bounds such as"),
        ({}, {}, "there is no option"),
        ({"rates": (0.0, 1.0)}, {}, "rates"),
        ({"rate": (0.0, 1.0)}, {"trials": 0}, "expected at least 1"),
        ({"weeks": [1]}, {"trials": 1, "objective": lambda rows: float("nan")}, "no trial has"),
        ({"rate": (0.0, 1.0)}, {"trials": 1, "objective": "hight"}, "no column 'hight'"),
    ],
)
def test_mistakes_are_explained(ranges, more, says):
    given = {"objective": "frames", "frames": 1, "workers": 1, "quiet": True, **more}
    with pytest.raises(MinervaError, match=says):
        calibrate(WORLD, ranges=ranges, **given)


class Vine(Agent, symbol="AVine"):
    height: float = 0.0
    rate: float = 1.0
    buds: int = 1
    wild: bool = False
    name: str = "0"

    @on("eHour")
    def grow(self, hour, moment):
        self.height += self.rate * self.buds * (2 if self.wild else 1) + float(self.name)


STRING_WORLD = World(
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
    result = calibrate(STRING_WORLD, off_targets, ranges, trials=12, sampler=sampler, **GIVEN)
    assert result.trials.columns == (*ranges, "value")
    for rate, buds, wild, value in result.trials.rows():
        heights = sorted([2 * rate * (1 + wild), 2.0 * buds * (1 + wild)])
        assert value == pytest.approx(abs(heights[0] - 3) + abs(heights[1] - 8))
    assert any(rate != int(rate) for rate in result.trials["#v0.rate"])
    assert result.value == min(result.trials["value"])
    assert dict(result.best) == dict(zip(ranges, min(result.trials.rows(), key=lambda row: row[3])[:3], strict=True))  # fmt: skip


def test_texts_that_look_like_numbers_remain_texts():
    result = calibrate(STRING_WORLD, off_targets, {"AVine.name": ["0", "10"]}, trials=6, **GIVEN)
    assert set(result.trials.rows()) <= {("0", 7.0), ("10", 33.0)}
    assert result.best == {"AVine.name": "0"}


def test_sweeps_and_branches_vary_the_string(tmp_path):
    table = sweep(STRING_WORLD, {"AVine.rate": [1.0, 4.0]}, frames=2, collect=HEIGHTS, workers=1, quiet=True)  # fmt: skip
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
def test_mistakes_in_parameters_of_the_string_are_explained(ranges, more, says):
    with pytest.raises(MinervaError, match=says):
        calibrate(STRING_WORLD, off_targets, ranges, trials=1, **GIVEN, **more)


def test_a_resumed_run_takes_no_values_of_the_string(tmp_path):
    world, record = pond(tmp_path), tmp_path / "pond.mcap"
    run(world, frames=2, record=record)
    words = ["run", str(world), "--resume", str(record), "--set", "ABud.vigour=1"]
    failed = CliRunner().invoke(app, words)
    assert "a resumed run continues with its own string" in str(failed.exception)
