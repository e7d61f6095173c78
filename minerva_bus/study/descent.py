"""The picture of a descent: who comes of whom, and what made the champion what it is."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from minerva_bus.study.evolution import Evolution, Individual
from minerva_bus.study.style import BEST, FAINT, INK, PALE, draw

WIDEST: Final = 34
"""Letters of a line beside the tree."""

Point = tuple[float, float]


def draw_descent(evolution: Evolution, name: str, path: Path) -> None:
    """Draw all individuals, a column for each generation, the best on top. Raises MisuseError."""
    champion = evolution.champion
    line = evolution.ancestors(champion)[::-1] if champion is not None else []
    log = evolution.logbook
    size = max(7.0, 1.5 + 0.75 * len(log)) + 3.6, max(4.5, 1.2 + 0.22 * evolution.plan.population)

    def paint(figure: Any) -> None:
        tree, words = figure.subplots(1, 2, width_ratios=(size[0] - 3.6, 3.6))
        _tree(tree, evolution, line)
        tree.set_title(f"{name}: descent of the champion")
        _words(words, _main_line(line))

    draw(path, size, paint)


def _tree(axis: Any, evolution: Evolution, line: Sequence[Individual]) -> None:
    points = _points(evolution)
    _lines(axis, evolution.all, points, PALE, 0.6)
    _lines(axis, line, points, BEST, 1.8)
    fine = [one for one in evolution.all if not one.score.failed]
    shown = axis.scatter(
        [points[one.number][0] for one in fine],
        [points[one.number][1] for one in fine],
        c=[one.score.fitness for one in fine],
        cmap="YlGnBu" + ("_r" if evolution.plan.minimise else ""),
        s=34,
        edgecolors=FAINT,
        linewidths=0.5,
        zorder=3,
    )
    failed = [points[one.number] for one in evolution.all if one.score.failed]
    if failed:
        axis.plot(*zip(*failed, strict=True), "x", color=INK, markersize=5, zorder=3)
    for one in line:
        axis.plot(*points[one.number], "o", ms=8, mfc="none", mec=BEST, mew=1.6, zorder=4)
    if fine:
        axis.figure.colorbar(shown, ax=axis, label="fitness", pad=0.01, aspect=40)
    axis.set(xlabel="generation", ylabel="rank in its generation")
    axis.invert_yaxis()
    for one in (axis.xaxis, axis.yaxis):
        one.get_major_locator().set_params(integer=True)


def _points(evolution: Evolution) -> dict[int, Point]:
    """Where each individual stands: its generation, and its rank in it."""
    by_generation: dict[int, list[Individual]] = {}
    for one in evolution.all:
        by_generation.setdefault(one.generation, []).append(one)
    return {
        one.number: (float(generation), float(rank))
        for generation, members in by_generation.items()
        for rank, one in enumerate(sorted(members, key=lambda m: m.merit, reverse=True), 1)
    }


def _lines(
    axis: Any, of: Sequence[Individual], points: dict[int, Point], color: str, width: float
) -> None:
    from matplotlib.collections import PathCollection

    ways = [_way(points[parent], points[one.number]) for one in of for parent in one.parents]
    axis.add_collection(
        PathCollection(ways, facecolors="none", edgecolors=color, linewidths=width, zorder=2)
    )


def _way(parent: Point, child: Point) -> Any:
    """A line that leaves and arrives level."""
    from matplotlib.path import Path as Way

    middle = (parent[0] + child[0]) / 2
    return Way(
        [parent, (middle, parent[1]), (middle, child[1]), child],
        [Way.MOVETO, Way.CURVE4, Way.CURVE4, Way.CURVE4],
    )


def _main_line(line: Sequence[Individual]) -> list[Individual]:
    """From the champion back, by the first parent each time; the oldest first."""
    by_number = {one.number: one for one in line}
    found = list(line[-1:])
    while found and found[-1].parents:
        found.append(by_number[found[-1].parents[0]])
    return found[::-1]


def _words(axis: Any, line: Sequence[Individual]) -> None:
    """What made each of a line of descent."""
    axis.axis("off")
    lines = [row for one in line for row in _told(one)]
    axis.set(xlim=(0, 1), ylim=(max(len(lines), 24) + 0.5, -0.5))
    for n, (first, text) in enumerate(lines):
        axis.text(
            0.0 if first else 0.16,
            n,
            text,
            fontsize=8,
            va="center",
            color=INK if first else FAINT,
        )


def _told(one: Individual) -> list[tuple[bool, str]]:
    fitness = f"{one.score.fitness:.4g}" if math.isfinite(one.score.fitness) else "failed"
    head = f"generation {one.generation}: {fitness}"
    steps = [row for how in one.how.split("; ") for row in textwrap.wrap(how, WIDEST)]
    return [(True, head), *((False, step) for step in steps)]
