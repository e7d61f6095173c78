"""Plots of collected series and histograms. Needs the extra `plot`.

A line has the mean of all rows with the same x, of seeds or agents; a band has the middle 80 % of
them. Along an option of a sweep, the rows are those of the last frame of each run.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_analysis.plotting import COLORS, FAINT, LINE_STYLES, Plot, label_ends, show_grid
from minerva_bus.collect.data_tables import SEED, DataTable
from minerva_bus.errors import MisuseError, nearest
from minerva_bus.settings.world_settings import WorldSettings

BAND: Final = (0.1, 0.9)
MAX_LINES: Final = 28
"""Lines of a plot: each colour with each style."""

MAX_LABELS: Final = 7
"""Lines up to which each has its name at its end, and no legend."""

MAX_MARKERS: Final = 12
"""Points of a line up to which each is marked, such as those of a sweep."""

_OWN: Final = ("frame", "time", "id", "sender", "receiver")
_BIN: Final = re.compile(r"(?P<name>.+)_(?P<number>[0-9]+)\Z")


@dataclass(frozen=True, slots=True)
class _Line:
    """A series of one combination of options: mean and band for each x, and the rows per x."""

    label: str
    unit: str
    x: NDArray[np.float64]
    mean: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    rows: int


def plot_table(
    table: DataTable,
    series: Sequence[str] = (),
    x: str = "",
    units: Mapping[str, str] | None = None,
    *,
    bars: bool = False,
) -> Plot:
    """A plot of the series of a table; see `DataTable.plot`. `units` are by column.

    Raises MisuseError, also without matplotlib.
    """
    x = _x_of(table, x)
    table, is_end = _at_end(table, x)
    bins = _histograms(table)
    names = series or _series_of(table, x, bins)
    lines = [
        line
        for name in names
        if name not in bins
        for line in _lines(table, x, name, (units or {}).get(name, ""))
    ]
    histograms = {name: bins[name] for name in names if name in bins}
    if not len(table) or not (lines or histograms):
        raise MisuseError(f"the table {table.name} has no numbers to plot")
    if len(lines) > MAX_LINES:
        raise MisuseError(
            f"the table {table.name} gives {len(lines)} lines, more than the {MAX_LINES} that can"
            " be told apart; choose some with --series"
        )
    panels = bool(lines) + len(histograms)

    def paint(figure: Any) -> None:
        axes = list(figure.subplots(panels, 1, squeeze=False)[:, 0])
        if lines:
            drawn = [name for name in names if name not in bins]
            title = ", ".join(drawn) if len(drawn) <= MAX_LABELS else table.name
            _draw_lines(axes.pop(0), lines, _label_of(x), title, _about(table, lines, is_end))
        for axis, (name, columns) in zip(axes, histograms.items(), strict=True):
            _draw_histogram(axis, table, x, name, columns, bars=bars)

    return Plot(table.name, (8.5, 0.6 + 3.6 * panels), paint)


def _keys(table: DataTable, x: str) -> list[str]:
    """The columns that distinguish runs: those before `frame`, as a sweep writes them, or x."""
    columns = [*table.columns]
    return columns[: columns.index("frame" if "frame" in columns else x)]


def _x_of(table: DataTable, wanted: str) -> str:
    numbers = [name for name, kind in table.types.items() if kind != "text"]
    if wanted:
        _check(table, wanted, numbers)
        return wanted
    for name in ("frame", "time", *numbers[:1]):
        if name in table.columns and not (name == "frame" and _is_timed(table)):
            return name
    raise MisuseError(f"the table {table.name} has no numbers to plot")


def _is_timed(table: DataTable) -> bool:
    """Whether the world has a `dt` of its own, so that the seconds of a frame mean something."""
    if "time" not in table.columns:
        return False
    return not np.allclose(table["time"], table["frame"] * WorldSettings().dt)


def _at_end(table: DataTable, x: str) -> tuple[DataTable, bool]:
    """The rows of each run's last frame, and True, if x is an option of a sweep."""
    if "frame" not in table.columns or x not in (keys := _keys(table, x)):
        return table, False
    runs = [*zip(*[table[key].tolist() for key in keys], strict=True)]
    frames = table["frame"].tolist()
    last: dict[tuple[Any, ...], int] = {}
    for run, frame in zip(runs, frames, strict=True):
        last[run] = max(frame, last.get(run, frame))
    rows = [last[run] == frame for run, frame in zip(runs, frames, strict=True)]
    columns = {column: table[column][np.array(rows)] for column in table.columns}
    return DataTable(table.name, table.types, columns), True


def _about(table: DataTable, lines: Sequence[_Line], is_end: bool) -> str:
    """What the values are, beside the title."""
    rows = max(line.rows for line in lines)
    what = "rows" if "id" in table.columns or SEED not in table.columns else "runs"
    parts = ["in the last frame"] * is_end
    parts += [f"mean and middle 80 % of up to {rows:,} {what}"] * (rows > 1)
    return ", ".join(parts)


def _series_of(table: DataTable, x: str, bins: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    taken = {
        x,
        *_OWN,
        *_keys(table, x),
        SEED,
        *(column for group in bins.values() for column in group),
    }
    names = [name for name, kind in table.types.items() if kind != "text" and name not in taken]
    return (*names, *bins)


def _histograms(table: DataTable) -> dict[str, list[str]]:
    """The columns of each histogram: NAME_0, NAME_1, ..., at least three."""
    groups: dict[str, list[str]] = {}
    for column, kind in table.types.items():
        match = _BIN.match(column)
        if match and kind == "int64" and int(match["number"]) == len(groups.get(match["name"], [])):
            groups.setdefault(match["name"], []).append(column)
    return {name: columns for name, columns in groups.items() if len(columns) > 2}


def _check(table: DataTable, name: str, allowed: Sequence[str]) -> None:
    if name not in allowed:
        what = "is a text" if name in table.columns else "does not exist"
        hint = nearest(name, list(allowed), f"there are {', '.join(allowed)}")
        raise MisuseError(f"{table.name}: the column {name!r} {what}{hint}")


def _lines(table: DataTable, x: str, name: str, unit: str) -> list[_Line]:
    _check(table, name, [column for column, kind in table.types.items() if kind != "text"])
    keys = [
        key for key in _keys(table, x) if key not in (SEED, x) and len({*table[key].tolist()}) > 1
    ]
    groups: dict[tuple[Any, ...], list[int]] = {}
    for row, key in enumerate(zip(*[table[key].tolist() for key in keys], strict=True)):
        groups.setdefault(key, []).append(row)
    rows = groups or {(): list(range(len(table)))}
    made: list[_Line] = []
    for key, members in rows.items():
        values = ", ".join(f"{k} {v}" for k, v in zip(keys, key, strict=True))
        label = f"{name}, {values}" if values else name
        made.append(_line(table[x][members], table[name][members], label, unit))
    return made


def _line(x: NDArray[Any], values: NDArray[Any], label: str, unit: str) -> _Line:
    order = np.argsort(x, kind="stable")
    x, values = x[order].astype(float), values[order].astype(float)
    places, begins = np.unique(x, return_index=True)
    parts = [part[np.isfinite(part)] for part in np.split(values, begins[1:])]
    # A place without numbers is a gap in the line.
    spread = [
        (part.mean(), *np.quantile(part, BAND)) if len(part) else (np.nan,) * 3 for part in parts
    ]
    mean, low, high = np.array(spread).reshape(-1, 3).T
    return _Line(label, unit, places, mean, low, high, max(map(len, parts), default=0))


def _label_of(x: str) -> str:
    return "time, s" if x == "time" else x


def _draw_lines(axis: Any, lines: Sequence[_Line], label: str, title: str, about: str) -> None:
    for number, line in enumerate(lines):
        color = COLORS[number % len(COLORS)]
        style = LINE_STYLES[number // len(COLORS)]
        if line.rows > 1:
            axis.fill_between(line.x, line.low, line.high, color=color, alpha=0.18, linewidth=0)
        marker = "o" if len(line.x) <= MAX_MARKERS else None
        axis.plot(line.x, line.mean, style, color=color, linewidth=1.7, label=line.label,
                  marker=marker)  # fmt: skip
    units = {line.unit for line in lines}
    axis.set(xlabel=label, ylabel=units.pop() if len(units) == 1 else "")
    show_grid(axis)
    axis.set_title(title)
    axis.set_title(about, loc="right", fontsize=8, fontweight="normal", color=FAINT)
    if len(lines) <= MAX_LABELS:
        _label_ends(axis, lines)
    else:
        axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1), fontsize=8)


def _label_ends(axis: Any, lines: Sequence[_Line]) -> None:
    units = {line.unit for line in lines}
    ends: list[tuple[float, str, str]] = []
    for number, line in enumerate(lines):
        finite = np.flatnonzero(np.isfinite(line.mean))
        if len(finite):
            unit = f" ({line.unit})" if line.unit and len(units) > 1 else ""
            color = COLORS[number % len(COLORS)]
            ends.append((float(line.mean[finite[-1]]), line.label + unit, color))
    label_ends(axis, ends)


def _draw_histogram(
    axis: Any, table: DataTable, x: str, name: str, columns: Sequence[str], *, bars: bool
) -> None:
    places, rows = np.unique(table[x], return_inverse=True)
    counts = np.zeros((len(places), len(columns)))
    for number, column in enumerate(columns):
        np.add.at(counts[:, number], rows, table[column])
    # The mean over seeds.
    counts /= np.bincount(rows)[:, None]
    if bars or len(places) == 1:
        axis.bar(range(len(columns)), counts[-1], width=0.92, color=COLORS[0])
        axis.set(xlabel=f"bin of {name}", ylabel="number")
        axis.set_title(f"{name}, {_label_of(x).split(',')[0]} {places[-1]:g}")
        return
    edges = np.append(places, 2 * places[-1] - places[-2])
    mesh = axis.pcolormesh(
        edges, np.arange(len(columns) + 1) - 0.5, counts.T, cmap="viridis", vmin=0, rasterized=True
    )
    axis.figure.colorbar(mesh, ax=axis, label="number", pad=0.01)
    axis.set(xlabel=_label_of(x), ylabel=f"bin of {name}", title=name)
