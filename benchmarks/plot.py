"""Plots of benchmarks with logarithmic axes; requires the extra `plot`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

MOST_TICKS = 8
LEAST_RANGE = 10


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a panel."""

    panel: str
    label: str
    x: list[float] | list[int]
    y: list[float]


def plotted(file: Path, lines: list[Line], x: str, y: str) -> None:
    """Draw the lines into an SVG or PNG file, with one panel per group."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        sys.exit("--plot needs matplotlib: pip install 'minerva-bus[plot]'")
    panels = list(dict.fromkeys(line.panel for line in lines))
    figure = Figure(figsize=(4.5 * max(1, len(panels)), 4), layout="constrained")
    axes = figure.subplots(1, max(1, len(panels)), squeeze=False)[0]
    for panel, axis in zip(panels, axes, strict=False):
        for line in lines:
            if line.panel == panel:
                axis.loglog(line.x, line.y, marker="o", markersize=5, label=line.label)
        axis.set(title=panel, xlabel=x, ylabel=y)
        axis.grid(visible=True, which="major", alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(fontsize="small", frameon=False)
        _label(axis, sorted({value for line in lines if line.panel == panel for value in line.x}))
    figure.savefig(file, dpi=150)


def _label(axis: Any, sizes: list[float]) -> None:
    """Format ticks as 5, 200, 10k, with x ticks at the measured sizes if there are few."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if len(sizes) <= MOST_TICKS:
        axis.set_xticks(sizes)
        axis.xaxis.minorticks_off()
    low, high = axis.get_ylim()
    if high < LEAST_RANGE * low:  # A small range would exaggerate small differences.
        middle = (low * high) ** 0.5
        low, high = axis.set_ylim(middle / LEAST_RANGE**0.5, middle * LEAST_RANGE**0.5)
    axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 1000 * low else (1,)))
    for ticks in (axis.xaxis, axis.yaxis):
        ticks.set_major_formatter(FuncFormatter(lambda value, _: _written(value)))
        ticks.set_minor_formatter(NullFormatter())


def _written(value: float) -> str:
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        # A power of two, such as 4,096, is not shorter with a letter.
        if value >= size and value % (size / 10) == 0:
            return f"{value / size:g}{letter}"
    return f"{value:,g}"
