"""`calibrate`: options for which runs are best, by Optuna over sweeps."""

import numpy as np
import pytest

pytest.importorskip("optuna", reason="pip install 'minerva-bus[optuna]'")

from minerva_bus import Agent, MinervaError, World, calibrate, each, on
from minerva_bus.grammar.symbols import EventType

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
    again = found(folder=folder)
    assert list(again.trials.rows()) == list(result.trials.rows())
    assert (folder / "runs.journal").read_text().splitlines()[:15] == lines[:15]


def test_a_column_of_outcomes_is_an_objective():
    given = {"trials": 2, "frames": 2, "workers": 1, "quiet": True}
    result = calibrate(WORLD, "frames", {"weeks": [1, 2]}, **given)
    assert result.value == 2.0


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
