"""Plots of an evolution: fitness over generations, and the family tree. Needs the extra `plot`."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from minerva_analysis.plotting import BEST, COLORS, FAINT, INK, PALE, draw, label_ends, show_grid
from minerva_study.evolution import Evolution, Individual

TEXT_WIDTH: Final = 34
"""Letters of a line below the tree."""

COLUMN_WIDTH: Final = 2.7
"""Inches of a column of the text below the tree."""

ROW_HEIGHT: Final = 0.17
"""Inches of a line of this text."""

Point = tuple[float, float]


# --- fitness ---


def draw_fitness(evolution: Evolution, name: str, path: Path) -> None:
    """Plot fitness over generations. Raises MisuseError."""
    draw(path, (8, 4.6), lambda figure: _fitness(figure.subplots(), evolution, name))


def _fitness(axis: Any, evolution: Evolution, name: str) -> None:
    log, plan = evolution.log, evolution.plan
    generations = [row.generation for row in log]
    children = [child for child in evolution.all if not child.score.failed]
    axis.plot(
        [child.generation for child in children],
        [child.score.fitness for child in children],
        "o",
        color=COLORS[0],
        alpha=0.25,
        markersize=4,
        markeredgewidth=0,
    )
    medians = [row.median for row in log]
    axis.plot(generations, medians, color=COLORS[0], linewidth=1.2)
    ends = [(medians[-1], "median of a generation", COLORS[0])]
    if evolution.random:
        style = {"color": FAINT, "linewidth": 1.8, "linestyle": "--"}
        axis.step(range(len(evolution.random)), evolution.random, where="post", **style)
        ends.append((evolution.random[-1], "random search, best so far", FAINT))
    best = best_so_far(evolution)
    style = {"color": BEST, "linewidth": 2.4}
    axis.step(generations, best, where="post", **style)
    ends.append((best[-1], "evolution, best so far", BEST))
    failed = [child.generation for child in evolution.all if child.score.failed]
    if failed:
        # A failed string has no fitness, so its mark is at the lower edge.
        low = axis.get_ylim()[0]
        axis.plot(failed, [low] * len(failed), "x", color=INK, markersize=5)
    axis.set_title(f"{name}: fitness" + (" (less is better)" if plan.minimise else ""))
    marks = ", each a dot (×: failed)" if failed else ", each a dot"
    axis.set_xlabel(f"generation of {plan.population} strings{marks}")
    axis.xaxis.get_major_locator().set_params(integer=True)
    show_grid(axis)
    label_ends(axis, [end for end in ends if math.isfinite(end[0])])


def best_so_far(evolution: Evolution) -> list[float]:
    """The best fitness up to each generation; NaN if all have failed."""
    better = min if evolution.plan.minimise else max
    series: list[float] = []
    for row in evolution.log:
        known = [value for value in (*series[-1:], row.best) if not math.isnan(value)]
        series.append(better(known) if known else math.nan)
    return series


# --- the family tree ---


def draw_tree(evolution: Evolution, name: str, path: Path) -> None:
    """Draw all individuals, a column per generation, the best on top. Raises MisuseError."""
    champion = evolution.champion
    line = evolution.ancestors(champion)[::-1] if champion is not None else []
    rows = [row for individual in _main_line(line) for row in _rows(individual)]
    # As narrow as a page, so that the texts stay legible on it.
    width = max(7.0, 1.5 + 0.45 * len(evolution.log))
    height = max(4.5, 1.2 + 0.22 * evolution.plan.population)
    columns = int(width / COLUMN_WIDTH)
    length = max(1, math.ceil(len(rows) / columns))
    below = 0.5 + ROW_HEIGHT * length

    def paint(figure: Any) -> None:
        tree, text = figure.subplots(2, 1, height_ratios=(height, below))
        _tree(tree, evolution, line)
        tree.set_title(f"{name}: ancestors of the champion")
        text.set_title("what changed on its line")
        text.axis("off")
        text.set(xlim=(0, columns), ylim=(length - 0.5, -0.5))
        _steps(text, rows, length)

    draw(path, (width, height + below), paint)


def _tree(axis: Any, evolution: Evolution, line: Sequence[Individual]) -> None:
    points = _points(evolution)
    _curves(axis, evolution.all, points, PALE, 0.4)
    _curves(axis, line, points, BEST, 1.8)
    fine = [individual for individual in evolution.all if not individual.score.failed]
    shown = axis.scatter(
        [points[individual.number][0] for individual in fine],
        [points[individual.number][1] for individual in fine],
        c=[individual.score.fitness for individual in fine],
        cmap="YlGnBu" + ("_r" if evolution.plan.minimise else ""),
        s=34,
        edgecolors=FAINT,
        linewidths=0.5,
        zorder=3,
    )
    failed = [points[i.number] for i in evolution.all if i.score.failed]
    if failed:
        axis.plot(*zip(*failed, strict=True), "x", color=INK, markersize=5, zorder=3)
    for individual in line:
        axis.plot(*points[individual.number], "o", ms=8, mfc="none", mec=BEST, mew=1.6, zorder=4)
    if fine:
        axis.figure.colorbar(shown, ax=axis, label="fitness", pad=0.01, aspect=40)
    axis.set(xlabel="generation", ylabel="rank in its generation")
    axis.invert_yaxis()
    for scale in (axis.xaxis, axis.yaxis):
        scale.get_major_locator().set_params(integer=True)


def _points(evolution: Evolution) -> dict[int, Point]:
    """The position of each individual: its generation, and its rank in it."""
    generations: dict[int, list[Individual]] = {}
    for individual in evolution.all:
        generations.setdefault(individual.generation, []).append(individual)
    return {
        individual.number: (float(generation), float(place))
        for generation, members in generations.items()
        for place, individual in enumerate(sorted(members, key=lambda m: m.rank, reverse=True), 1)
    }


def _curves(
    axis: Any, of: Sequence[Individual], points: dict[int, Point], color: str, width: float
) -> None:
    from matplotlib.collections import PathCollection

    curves = [
        _curve(points[parent], points[child.number]) for child in of for parent in child.parents
    ]
    axis.add_collection(
        PathCollection(curves, facecolors="none", edgecolors=color, linewidths=width, zorder=2)
    )


def _curve(parent: Point, child: Point) -> Any:
    """A curve that is horizontal at both ends."""
    from matplotlib.path import Path as Curve

    middle = (parent[0] + child[0]) / 2
    return Curve(
        [parent, (middle, parent[1]), (middle, child[1]), child],
        [Curve.MOVETO, Curve.CURVE4, Curve.CURVE4, Curve.CURVE4],
    )


def _main_line(line: Sequence[Individual]) -> list[Individual]:
    """The champion and its first parents, the oldest first."""
    by_number = {individual.number: individual for individual in line}
    main = list(line[-1:])
    while main and main[-1].parents:
        main.append(by_number[main[-1].parents[0]])
    return main[::-1]


def _steps(axis: Any, rows: Sequence[tuple[bool, str]], length: int) -> None:
    """List the mutations along a line of descent, in columns of this length."""
    for n, (first, text) in enumerate(rows):
        column, row = divmod(n, length)
        indent, color = (0.0, INK) if first else (0.06, FAINT)
        axis.text(column + indent, row, text, fontsize=8, va="center", color=color)


def _rows(individual: Individual) -> list[tuple[bool, str]]:
    fitness = individual.score.fitness
    shown = f"{fitness:.4g}" if math.isfinite(fitness) else "failed"
    head = f"generation {individual.generation}: fitness {shown}"
    steps = [row for how in individual.how.split("; ") for row in textwrap.wrap(how, TEXT_WIDTH)]
    return [(True, head), *((False, step) for step in steps)]
