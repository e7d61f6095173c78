"""Whole worlds under faults: the invariants of every history, checked on hundreds."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from minerva_bus.errors import UserCodeError
from minerva_bus.wire.keys import COORDINATOR
from tests.simulator import trying
from tests.simulator.history import Fault, History, drawn
from tests.simulator.trying import report, tried, tried_seed
from tests.simulator.writing import read_back, written

HISTORIES = range(0, 1000, 25)
"""The first seeds of groups of histories."""
USUAL = 125
"""The histories of each run; the others run on demand, and CI plays others each day.

The broken engines of test_broken_engines.py are detected within the first 110.
"""
FAILED = Path(__file__).with_name("failed.jsonl")
"""Histories that failed once, each with its error."""

pytestmark = pytest.mark.timeout(300)


@pytest.mark.parametrize(
    "first",
    [pytest.param(n, marks=pytest.mark.slow) if n >= USUAL else n for n in HISTORIES],
)
def test_histories_go_well(first):
    for seed in range(first, first + HISTORIES.step):
        again = tried_seed(seed)
        assert not again.wrong, report(again)


@pytest.mark.parametrize("line", FAILED.read_text().splitlines())
def test_histories_that_failed_once_go_well(line):
    history, reason = read_back(line)
    again = tried(history)
    assert not again.wrong, f"{reason}\n{report(again)}"


def test_a_history_is_read_back_as_it_was_written():
    assert read_back(written(drawn(3), "why")) == (drawn(3), "why")


class Interruption(BaseException):
    """As pytest-timeout raises it, anywhere in the code."""


def test_an_interruption_is_no_failure_of_a_history(monkeypatch):
    def interrupted(history, folder):
        try:
            raise Interruption
        except BaseException as error:
            raise UserCodeError("Goat.picture", interrupted) from error

    monkeypatch.setattr(trying, "play", interrupted)
    with pytest.raises(Interruption):
        tried(drawn(0))


TRACES = """
from tests.simulator.trying import tried_seed
for seed in (1, 2, 3, 5, 8):
    print(*tried_seed(seed).trace, sep="\\n")
"""


def test_a_history_is_the_same_each_time_and_in_each_process():
    """The order of sets of texts depends on the hash seed and must not affect a history."""
    traces = [
        subprocess.run(
            [sys.executable, "-c", TRACES], env={**os.environ, "PYTHONHASHSEED": number},
            capture_output=True, text=True, check=True,
        ).stdout
        for number in ("1", "2")
    ]  # fmt: skip
    assert traces[0].splitlines() == traces[1].splitlines()


@pytest.mark.parametrize("frame", [0, 3])
def test_a_coordinator_that_is_frozen_for_good_is_succeeded(frame):
    frozen = Fault(frame, 0.01, "freeze", COORDINATOR, 10_000.0)
    again = tried(History(5, 12, 10.0, 0.0, (frozen,)))
    assert not again.wrong, report(again)
    assert any("stopped by a signal for 10 s: killing it" in line for line in again.trace), report(
        again
    )


def test_histories_go_on_where_they_were_interrupted(tmp_path):
    """Two runs with results are one; results of other code begin again."""
    path = tmp_path / "results.json"

    def played(histories):
        words = ["--histories", str(histories), "--results", str(path), "--json"]
        done = subprocess.run(
            [sys.executable, "-m", "tests.simulation", *words],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return json.loads(done.stdout)

    first, both = played(2), played(3)
    assert (first["histories"], both["histories"]) == (2, 3)
    assert both["frames"] == sum(tried_seed(seed).frames for seed in range(3))
    kept = json.loads(path.read_text())
    assert kept == both
    path.write_text(json.dumps(kept | {"code": "other", "frames": 1000}))
    assert played(1)["frames"] < 1000
