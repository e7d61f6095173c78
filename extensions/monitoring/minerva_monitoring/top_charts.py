"""Charts of collected series in the dashboard."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Final

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Sparkline, Static

from minerva_bus.world.operator import CollectedSeries

MAX_CHARTS: Final = 6
"""Charts that fit beside each other."""


class SeriesChart(Vertical):
    """The course of one series, with its last value, least and greatest value."""

    DEFAULT_CSS = """
    SeriesChart { width: 1fr; height: 6; border: round $surface-lighten-2; padding: 0 1;
                  border-title-color: $accent; }
    SeriesChart Sparkline { height: 2; }
    """

    def compose(self) -> ComposeResult:
        """Create the widgets."""
        yield Static(classes="last")
        yield Sparkline([], summary_function=_mean)
        yield Static(classes="range")

    def show(self, series: CollectedSeries) -> None:
        """Show a series."""
        values = [value for value in series.values if isfinite(value)]
        unit = f" {series.unit}" if series.unit else ""
        self.border_title = series.name
        last = series.values[-1] if series.values else float("nan")
        text = f"{last:,.5g}{unit}" if isfinite(last) else "nothing counted"
        self.query_one(".last", Static).update(Text(text, "bold"))
        self.query_one(Sparkline).data = values
        between = f"{min(values):,.4g} to {max(values):,.4g}{unit}" if values else ""
        self.query_one(".range", Static).update(Text(between, "bright_black"))


class SeriesCharts(Horizontal):
    """Charts of the first series that a world collects; hidden if it collects none."""

    DEFAULT_CSS = """
    SeriesCharts { height: auto; display: none; }
    """

    def show(self, series: Sequence[CollectedSeries]) -> None:
        """Show series; a chart stays in its place while its series exists."""
        shown = [each for each in series if each.frames][:MAX_CHARTS]
        charts = [*self.query(SeriesChart)]
        # The widgets of a new chart exist only after it is mounted, so it is filled next time.
        if len(charts) < len(shown):
            self.mount_all([SeriesChart() for _ in shown[len(charts) :]])
        for chart, each in zip(charts, shown, strict=False):
            if chart.is_mounted:
                chart.show(each)
        self.display = bool(shown)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
