"""The tree of a record and its branches: frames along the axis, a line for each run."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from minerva_analysis.plotting import COLORS, FAINT, INK, draw
from minerva_bus.collect.data_tables import SEED
from minerva_study.grid import Combination
from minerva_study.results import Row
from minerva_study.sweep_runs import Sweep

MAX_NAMED: Final = 40
"""Branches up to which each has its name; with more, each combination of options."""

BEND: Final = 0.15
"""Part of the way from the branch point to the end in which a line leaves the trunk."""


def draw_branches(
    runs: Sweep, name: str, frame: int, unchanged: Combination | None, path: Path
) -> None:
    """Draw the recorded run up to a frame, and each finished branch up to its last frame.

    Args:
        runs: the branches; those with the same options have one color.
        name: of the record.
        frame: from which they continue.
        unchanged: the branch in which nothing differs from the record, drawn in black.
        path: of the picture, .png, .svg or .pdf.

    Raises MisuseError.

    """
    rows = [runs.rows[c] for c in runs.grid if c in runs.rows and not runs.rows[c].error]
    groups = list(dict.fromkeys(_options(runs, row) for row in rows))

    def paint(figure: Any) -> None:
        axis = figure.subplots()
        axis.plot([0, frame], [0, 0], color=INK, linewidth=2)
        for at, row in enumerate(rows):
            y, end = _height(at, len(rows)), int(row.outcome["frames"])
            own = row.combination == unchanged
            color = INK if own else COLORS[groups.index(_options(runs, row)) % len(COLORS)]
            bend = frame + BEND * (end - frame)
            axis.plot([frame, bend, end], [0, y, y], color=color, linewidth=2 if own else 1)
            axis.plot([end], [y], "o", color=color, markersize=3)
            if len(rows) <= MAX_NAMED:
                _label(axis, end, y, runs.named(row), color)
        if len(rows) > MAX_NAMED:
            _label_groups(axis, runs, rows, groups)
        axis.set_title(f"{name}: {len(rows)} branches from frame {frame}")
        axis.set_xlabel("frame")
        axis.set_yticks([])
        axis.spines["left"].set_visible(False)
        axis.margins(x=0.02)

    draw(path, (8.5, 1.4 + 0.17 * min(max(len(rows), 6), MAX_NAMED)), paint)


def _height(at: int, count: int) -> float:
    """The place of a branch, the first one on top, around the trunk at 0."""
    return (count - 1) / 2 - at


def _options(runs: Sweep, row: Row) -> str:
    """The options of a branch without its seed, or "" if there are none."""
    pairs = zip(runs.grid.keys, row.combination, strict=True)
    return ", ".join(f"{key}={value}" for key, value in pairs if key != SEED)


def _label_groups(axis: Any, runs: Sweep, rows: list[Row], groups: list[str]) -> None:
    for number, group in enumerate(groups):
        own = [at for at, row in enumerate(rows) if _options(runs, row) == group]
        end = max(int(rows[at].outcome["frames"]) for at in own)
        y = sum(_height(at, len(rows)) for at in own) / len(own)
        text = f"{group}  ({len(own)} seeds)" if group else f"{len(own)} seeds"
        _label(axis, end, y, text, COLORS[number % len(COLORS)] if group else FAINT)


def _label(axis: Any, x: float, y: float, text: str, color: str) -> None:
    axis.annotate(
        text, (x, y), (6, 0), textcoords="offset points", va="center", color=color, fontsize=8
    )
