"""Diagrams of benchmarks, with logarithmic axes. Needs the extra `plot`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Line:
    """One line of one panel."""

    panel: str
    label: str
    x: list[float] | list[int]
    y: list[float]


def plotted(file: Path, lines: list[Line], x: str, y: str) -> None:
    """Draw the lines, a panel for each group of them, into an SVG or PNG file."""
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
                axis.loglog(line.x, line.y, marker="o", label=line.label)
        axis.set(title=panel, xlabel=x, ylabel=y)
        axis.grid(visible=True, which="major", alpha=0.3)
        axis.legend(fontsize="small")
    figure.savefig(file)
