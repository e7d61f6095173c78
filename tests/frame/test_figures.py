"""Figures that services report: what they may be, and how a run shows them."""

import pytest

from minerva_bus import Device
from minerva_bus.errors import UserCodeError
from minerva_bus.frame.member_side import figures_by
from minerva_bus.launch.console import RunSummary


class Reporter(Device, draws=("eShow",)):
    def __init__(self, figures):
        self.figures = figures

    def show(self, view):
        pass

    def report(self):
        return self.figures


@pytest.mark.parametrize("figures", [5, 0, [], ["a"], "text", "", True, {1}, print])
def test_figures_are_a_mapping(figures):
    with pytest.raises(UserCodeError, match=r"Reporter\.report: it returns .*; figures are a map"):
        figures_by(Reporter(figures))


@pytest.mark.parametrize("figures", [None, {}, {"a": float("nan")}])
def test_there_may_be_none(figures):
    assert figures_by(Reporter(figures)) == {}


def test_a_figure_cannot_control_the_terminal():
    figures = {"a\n\x1b[2J": "b\r\x07\ncd", "no_end": 1.5}
    lines = RunSummary("w", 0, "d", False, "", 0.0, None, 1, 0, {}, figures).lines()
    assert lines[3:5] == ["  a ?[2J: b?? cd", "  no end: 1.50"]


def test_the_summary_names_who_reported_a_figure_and_says_how_late_frames_were():
    figures = {"late_frames": 4, "seconds_behind": 0.041, "hits": 2}
    summary = RunSummary(
        "w", 0, "d", False, "", 0.0, None, 1, 0, {}, figures, reporters={"hits": "physics"}
    )
    assert summary.lines()[3:5] == ["  4 frames late, by 0.04 s in all", "  hits: 2 (physics)"]
