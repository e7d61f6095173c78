"""Plots of benchmarks in the style of `minerva plot`; requires the extra `plot`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from minerva_analysis.plotting import COLORS, LINE_STYLES, draw, label_ends, show_grid
from minerva_bus.errors import MisuseError

MAX_SIZES: Final = 12
"""Values of x up to which each has its mark and its tick, on a logarithmic axis."""

WIDE_RANGE: Final = 10
"""Ratio of the largest to the smallest y from which the axis is logarithmic."""


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a panel."""

    panel: str
    label: str
    x: list[float] | list[int]
    y: list[float]


def plotted(file: Path, lines: list[Line], x: str, y: str) -> None:
    """Draw the lines into an SVG, PNG or PDF file, with one panel per group.

    `x` and `y` name the axes with their units. An axis is linear and begins at 0 if its values are
    close together, because a logarithm would exaggerate small differences.
    """
    panels: dict[str, list[Line]] = {}
    for line in lines:
        panels.setdefault(line.panel, []).append(line)

    def paint(figure: Any) -> None:
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for (title, members), axis in zip(panels.items(), axes, strict=True):
            axis.set_title(title)
            _panel(axis, members)
            axis.set_xlabel(x)
        axes[0].set_ylabel(y)

    try:
        draw(file, (2.6 + 4.2 * len(panels), 3.9), paint)
    except MisuseError as error:
        sys.exit(str(error))


def _panel(axis: Any, lines: list[Line]) -> None:
    sizes = sorted({value for line in lines for value in line.x})
    few = len(sizes) <= MAX_SIZES
    ends: list[tuple[float, str, str]] = []
    for number, line in enumerate(lines):
        color, style = COLORS[number % len(COLORS)], LINE_STYLES[number // len(COLORS)]
        axis.plot(line.x, line.y, style, marker="o" if few else "", markersize=4, color=color)
        ends.append((line.y[-1], line.label, color))
    _scale(axis, sizes if few else [], [value for line in lines for value in line.y])
    show_grid(axis)
    label_ends(axis, ends)


def _scale(axis: Any, sizes: list[float], values: list[float]) -> None:
    """Choose both scales, with a tick at each of `sizes` and ticks such as 5, 200 and 10k."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if sizes:
        axis.set_xscale("log")
        axis.set_xticks(sizes)
        axis.xaxis.minorticks_off()
    if max(values) < WIDE_RANGE * min(values):
        axis.set_ylim(0, 1.15 * max(values))
    else:
        axis.set_yscale("log")
        near = max(values) < 1000 * min(values)
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if near else (1,)))
        axis.yaxis.minorticks_off()
    for ticks in (axis.xaxis, axis.yaxis):
        ticks.set_major_formatter(FuncFormatter(lambda value, _: _written(value)))
        ticks.set_minor_formatter(NullFormatter())


def _written(value: float) -> str:
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        # A power of two, such as 4,096, is not shorter with a letter.
        if value >= size and value % (size / 10) == 0:
            return f"{value / size:g}{letter}"
    return f"{value:,g}"
