"""Plots of tables: series with the spread over seeds, histograms, and wrong input."""

import sys

import numpy as np
import pytest

from extensions.analysis.tests.test_table_files import swept
from minerva_analysis import series_plot
from minerva_analysis.series_plot import plot_table
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import MisuseError

pytest.importorskip("matplotlib", reason="pip install 'minerva-bus[plot]'")


def test_lines_have_the_mean_and_quantiles_over_seeds_for_each_option():
    lines = series_plot._lines(swept(), "time", "n", "m")
    assert [line.label for line in lines] == ["n, birds 1", "n, birds 2"]
    assert lines[1].x.tolist() == [0, 0.5, 1, 1.5, 2]
    assert lines[1].mean.tolist() == [21, 22, 23, 24, 25]
    assert lines[1].low.tolist() == pytest.approx([20.2, 21.2, 22.2, 23.2, 24.2])
    assert lines[1].high.tolist() == pytest.approx([21.8, 22.8, 23.8, 24.8, 25.8])
    gap = series_plot._lines(swept(), "frame", "gap", "")[0]
    assert np.isnan(gap.mean).tolist() == [False, False, True, False, False]


def test_the_axis_has_frames_unless_the_world_has_a_time_of_its_own():
    numbers = np.arange(4)
    types = {"frame": "int64", "time": "float64", "n": "int64"}
    for dt, expected in ((0.1, "frame"), (0.5, "time")):
        table = DataTable("t", types, {"frame": numbers, "time": numbers * dt, "n": numbers})
        assert series_plot._x_of(table, "") == expected


def test_along_an_option_the_values_are_those_of_the_last_frame_of_each_run():
    table, is_end = series_plot._at_end(swept(), "birds")
    (line,) = series_plot._lines(table, "birds", "n", "")
    whole = swept()
    ends = whole["n"][whole["frame"] == whole["frame"].max()]
    expected = [ends[:3].mean(), ends[3:].mean()]
    assert (line.label, line.x.tolist(), line.mean.tolist()) == ("n", [1, 2], expected)
    assert series_plot._about(table, [line], is_end) == (
        "in the last frame, mean and middle 80 % of up to 3 runs"
    )
    assert series_plot._at_end(swept(), "frame")[1] is False


def test_columns_are_series_or_bins_of_histograms():
    table = swept()
    bins = series_plot._histograms(table)
    assert bins == {"size": ["size_0", "size_1", "size_2", "size_3"]}
    assert series_plot._series_of(table, "time", bins) == ("n", "gap", "size")


@pytest.mark.parametrize("options", [
    {}, {"bars": True}, {"x": "frame", "series": ("n",), "units": {"n": "m"}}, {"series": ("size",)},
])  # fmt: skip
def test_a_picture_is_written(tmp_path, options):
    plot_table(swept(), **options).save(tmp_path / "p.svg")
    text = (tmp_path / "p.svg").read_text()
    assert text.startswith("<?xml")
    plot_table(swept(), **options).save(tmp_path / "q.svg")
    assert len((tmp_path / "q.svg").read_text()) == len(text)


@pytest.mark.parametrize(("options", "problem"), [
    ({"series": ("m",)}, "the column 'm' does not exist"),
    ({"x": "bird"}, "did you mean 'birds'"),
])  # fmt: skip
def test_wrong_columns_are_reported(options, problem):
    with pytest.raises(MisuseError, match=problem):
        plot_table(swept(), **options)
    empty = DataTable("e", {"name": "text"}, {"name": np.array(["a"], object)})
    with pytest.raises(MisuseError, match="no numbers to plot"):
        plot_table(empty)


def test_names_without_end_are_cut_and_a_dollar_sign_is_no_formula(tmp_path, recwarn):
    numbers = np.arange(3.0)
    columns = {"frame": numbers, "n" * 100_000: numbers, "$\\frac$": numbers * 5e307}
    table = DataTable("t" * 100_000, dict.fromkeys(columns, "float64"), columns)
    plot_table(table, units={"$\\frac$": "m"}).save(tmp_path / "long.svg")
    assert len((tmp_path / "long.svg").read_text()) < 200_000
    assert not recwarn.list


def test_without_the_library_a_plot_names_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MisuseError, match=r"plotting needs matplotlib: .*install.*\[plot\]"):
        swept().plot()
