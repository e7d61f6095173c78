"""The public comparison: how rows are derived, and that the systems' models behave alike."""

import statistics
from dataclasses import replace
from importlib import import_module

import pytest

from benchmarks.comparison.__main__ import Row, from_publication, related
from benchmarks.comparison.parameters import MODELS, PARAMETERS
from benchmarks.comparison.published import LINES, TIMES
from benchmarks.comparison.systems import java_lines, python_lines


def test_lines_of_python_exclude_comments_and_documentation():
    source = (
        '"""Doc."""\n\n# Comment.\nx = """a\nb"""\n\ndef f():\n    """Doc."""\n    return x  # y\n'
    )
    assert python_lines(source) == 4


def test_lines_of_java_exclude_comments():
    assert java_lines("/* a\n b */\nint x; // y\n\n// z\n}\n") == 2


def test_measured_times_are_related_to_minerva_and_by_mesa_to_agents_jl():
    rows = [
        Row("minerva", "flocking", "small", "measured", 1, 2.0),
        Row("mesa", "flocking", "small", "measured", 1, 20.0),
    ]
    ours, mesa = related(rows)
    assert (ours.ratio, mesa.ratio) == (1.0, 10.0)
    assert mesa.to_agents_jl == TIMES["flocking", "small"]["mesa"]
    assert ours.to_agents_jl == pytest.approx(TIMES["flocking", "small"]["mesa"] / 10)


def test_published_rows_have_no_measured_time():
    rows = from_publication("schelling", "large", {"ark.jl"})
    assert rows == [Row("ark.jl", "schelling", "large", "published", to_agents_jl=0.59, lines=78)]
    assert from_publication("forest_fire", "large", {"ark.jl"}) == []


def test_published_tables_name_the_same_systems():
    for (model, _), times in TIMES.items():
        assert model in MODELS
        assert times.keys() == LINES[model].keys()


SHORT = {
    "wolf_sheep": {"steps": 60},
    "flocking": {"steps": 30, "birds": 100},
    "schelling": {},
    "forest_fire": {"side": 40, "steps": 60},
}
SEEDS = range(6)
DEVIATIONS = 4


@pytest.mark.parametrize("model", MODELS)
def test_the_models_behave_as_those_of_mesa_within_their_spread(model):
    pytest.importorskip("mesa")
    parameters = replace(PARAMETERS[model, "small"], **SHORT[model])
    runs = {}
    for package in ("models", "mesa_models"):
        module = import_module(f"benchmarks.comparison.{package}.{model}")
        runs[package] = [module.run(parameters, seed)() for seed in SEEDS]
    for name in runs["models"][0]:
        ours, theirs = ([row[name] for row in rows] for rows in runs.values())
        spread = (statistics.variance(ours) + statistics.variance(theirs)) / len(SEEDS)
        difference = abs(statistics.fmean(ours) - statistics.fmean(theirs))
        assert difference < DEVIATIONS * spread**0.5 + 0.005, (name, ours, theirs)
