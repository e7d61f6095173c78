"""The public comparison: what counts as a line, and that the systems' models behave alike."""

import statistics
from dataclasses import replace
from importlib import import_module

import pytest

from benchmarks.comparison.parameters import PARAMETERS, SIZES
from benchmarks.comparison.systems import java_lines, python_lines


def test_lines_of_python_exclude_comments_and_documentation():
    source = (
        '"""Doc."""\n\n# Comment.\nx = """a\nb"""\n\ndef f():\n    """Doc."""\n    return x  # y\n'
    )
    assert python_lines(source) == 4


def test_lines_of_java_exclude_comments():
    assert java_lines("/* a\n b */\nint x; // y\n\n// z\n}\n") == 2


SHORT = (
    ("wolf_sheep", {"steps": 5}),
    ("wolf_sheep", {"steps": 20}),
    ("wolf_sheep", {"steps": 60}),
    ("flocking", {"steps": 30, "birds": 100}),
    ("flocking", {"steps": 60, "birds": 60}),
    ("schelling", {"steps": 2}),
    ("schelling", {"steps": 5}),
    ("schelling", {"steps": 20}),
    ("forest_fire", {"side": 40, "steps": 60}),
    ("wealth", {"people": 300, "steps": 10}),
    ("wealth", {"people": 300, "steps": 40}),
)
"""Small models; those with several numbers of steps compare the curve, not the end only."""
SEEDS = range(6)
DEVIATIONS = 4


def is_alike(ours, theirs):
    """Whether two samples of a statistic differ by less than their spread allows."""
    spread = (statistics.variance(ours) + statistics.variance(theirs)) / len(ours)
    difference = abs(statistics.fmean(ours) - statistics.fmean(theirs))
    return difference < DEVIATIONS * spread**0.5 + 0.005


def results(package, model, parameters):
    module = import_module(f"benchmarks.comparison.{package}.{model}")
    return [module.run(parameters, seed)() for seed in SEEDS]


@pytest.mark.parametrize(("model", "changes"), SHORT)
def test_the_models_behave_as_those_of_mesa_within_their_spread(model, changes):
    """Numbers of animals, clusters of neighbours, order of the flock, burnt trees, inequality."""
    pytest.importorskip("mesa")
    parameters = replace(PARAMETERS[model, "small"], **changes)
    runs = [results(package, model, parameters) for package in ("models", "mesa_models")]
    for name in runs[0][0]:
        ours, theirs = ([row[name] for row in rows] for rows in runs)
        assert is_alike(ours, theirs), (name, ours, theirs)


def test_a_flock_that_acts_at_once_becomes_as_ordered_as_one_that_acts_in_turns():
    parameters = replace(PARAMETERS["flocking", "small"], birds=100, steps=60)
    ours, others = (
        results("models", name, parameters) for name in ("flocking_at_once", "flocking")
    )
    assert is_alike([row["order"] for row in ours], [row["order"] for row in others])


def test_every_parameter_set_is_of_a_model():
    for model, size in PARAMETERS:
        import_module(f"benchmarks.comparison.models.{model}")
        assert size in SIZES
        assert (model, "small") in PARAMETERS
