"""The results of a sweep, compared: a table of means as text, and a plot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, Final

from minerva_analysis.plotting import COLORS, INK, draw, show_grid
from minerva_bus.collect.data_tables import SEED
from minerva_bus.launch.toml_tables import option_text
from minerva_study.results import ResultTable

MAX_ROWS: Final = 40
"""Rows of the text."""

MAX_PANELS: Final = 6
SPREAD: Final = 0.12
"""Distance over which the dots of equal runs are spread, so that all are visible."""


def shown(table: ResultTable) -> list[str]:
    """The table as text: a row per combination, with mean and range over all seeds."""
    # Runs with different seeds repeat one combination, unless nothing else varies.
    keys = [key for key in table.keys if key != SEED] or list(table.keys)
    groups = _groups(table, keys)
    titles = [*keys, "runs", *table.measures]
    rows = [[*group, *_cells(table, members)] for group, members in list(groups.items())[:MAX_ROWS]]
    widths = [max(len(row[n]) for row in [titles, *rows]) for n in range(len(titles))]
    lines = [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in [titles, *rows]
    ]
    more = len(groups) - MAX_ROWS
    return [*lines, f"and {more} more"] if more > 0 else lines


def _groups(table: ResultTable, keys: Sequence[str]) -> dict[tuple[str, ...], list[int]]:
    """The numbers of the rows of each combination of these options."""
    groups: dict[tuple[str, ...], list[int]] = {}
    columns = [table.column(key) for key in keys]
    for n in range(len(table.rows)):
        groups.setdefault(tuple([option_text(column[n]) for column in columns]), []).append(n)
    return groups


def _cells(table: ResultTable, members: Sequence[int]) -> list[str]:
    errors = table.column("error")
    fine = [n for n in members if errors[n] is None]
    failed = len(members) - len(fine)
    count = f"{len(fine)}" + (f" ({failed} failed)" if failed else "")
    return [count, *[_spread(_known(table.column(name), fine)) for name in table.measures]]


def _known(values: Sequence[Any], members: Sequence[int]) -> list[float]:
    return [float(values[n]) for n in members if values[n] is not None]


def _spread(values: Sequence[float]) -> str:
    if not values:
        return "-"
    mean, least, greatest = fmean(values), min(values), max(values)
    return f"{mean:.4g}" if least == greatest else f"{mean:.4g} ({least:.4g}..{greatest:.4g})"


def draw_comparison(table: ResultTable, name: str, path: Path) -> None:
    """Draw each measure that varies over the options: a dot per run, a line for the mean.

    Raises MisuseError.
    """
    keys = [key for key in table.keys if key != SEED] or list(table.keys)
    varying = [name for name in table.measures if len(set(table.column(name)) - {None}) > 1]
    # A measure that is the same in all runs shows nothing, unless there is no other.
    measures = (varying or table.measures)[:MAX_PANELS]
    rows = max(1, (len(measures) + 1) // 2)
    columns = 1 if len(measures) < 2 else 2

    def paint(figure: Any) -> None:
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        figure.suptitle(f"{name}: {len(table.rows)} runs", x=0.02, ha="left", color=INK)
        for axis, measure in zip(axes, measures, strict=False):
            _panel(axis, table, keys, measure)
        _legend(axes[0], keys[1:], _lanes(table, keys))
        for axis in axes[len(measures) :]:
            axis.axis("off")

    draw(path, (5.2 * columns + 1, 3.2 * rows + 0.6), paint)


def _panel(axis: Any, table: ResultTable, keys: Sequence[str], measure: str) -> None:
    """Draw a measure: the first option along the axis, a colour per combination of the others."""
    groups = _groups(table, keys)
    values = table.column(measure)
    firsts = list(dict.fromkeys(group[0] for group in groups))
    others = _lanes(table, keys)
    for group, members in groups.items():
        known = _known(values, members)
        lane = others.index(group[1:])
        at = firsts.index(group[0]) + (lane - (len(others) - 1) / 2) * 0.8 / len(others)
        color = COLORS[lane % len(COLORS)]
        # Equal results would hide each other at one place.
        steps = [(n + 0.5) / len(known) - 0.5 for n in range(len(known))]
        places = [at + 2 * SPREAD * step / len(others) for step in steps]
        axis.plot(places, known, "o", color=color, alpha=0.7, markersize=4, markeredgewidth=0)
        if known:
            half = 0.3 / len(others)
            axis.hlines(fmean(known), at - half, at + half, color=color, linewidth=2.2)
    axis.set_title(measure.replace("_", " "))
    axis.set_xticks(range(len(firsts)), firsts, rotation=0 if len(firsts) < 7 else 60)
    axis.set_xlabel(keys[0])
    show_grid(axis, "y")


def _lanes(table: ResultTable, keys: Sequence[str]) -> list[tuple[str, ...]]:
    """The combinations of all options but the first, drawn side by side."""
    return list(dict.fromkeys(group[1:] for group in _groups(table, keys)))


def _legend(axis: Any, keys: Sequence[str], others: Sequence[tuple[str, ...]]) -> None:
    from matplotlib.lines import Line2D

    if len(others) < 2:
        return
    handles = [
        Line2D([], [], color=COLORS[n % len(COLORS)], linewidth=2.2, label=", ".join(lane))
        for n, lane in enumerate(others[: len(COLORS)])
    ]
    axis.legend(handles=handles, title=", ".join(keys), fontsize=8, labelcolor=INK)
