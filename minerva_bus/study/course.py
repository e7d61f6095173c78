"""The picture of an evolution: fitness over generations, beside random search at equal cost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from minerva_bus.study.evolution import Evolution
from minerva_bus.study.style import BEST, COLORS, FAINT, INK, draw


def draw_course(evolution: Evolution, name: str, path: Path) -> None:
    """Plot fitness over generations. Raises MisuseError."""
    draw(path, (8, 4.6), lambda figure: _paint(figure.subplots(), evolution, name))


def _paint(axis: Any, evolution: Evolution, name: str) -> None:
    log, plan = evolution.logbook, evolution.plan
    generations, medians = log.select("generation", "median")
    children = [child for child in evolution.all if not child.score.failed]
    axis.plot(
        [child.generation for child in children],
        [child.score.fitness for child in children],
        "o",
        color=COLORS[0],
        alpha=0.25,
        markersize=4,
        markeredgewidth=0,
        label="each string",
    )
    axis.plot(generations, medians, color=COLORS[0], linewidth=1.2, label="median of a generation")
    if evolution.random:
        axis.step(
            range(len(evolution.random)),
            evolution.random,
            where="post",
            color=FAINT,
            linewidth=1.8,
            linestyle="--",
            label="random search, best so far",
        )
    axis.step(
        generations,
        best_so_far(evolution),
        where="post",
        color=BEST,
        linewidth=2.4,
        label="evolution, best so far",
    )
    failed = [child.generation for child in evolution.all if child.score.failed]
    if failed:
        low = axis.get_ylim()[0]
        axis.plot(failed, [low] * len(failed), "x", color=INK, markersize=5, label="failed")
    axis.set_title(f"{name}: fitness" + (" (less is better)" if plan.minimise else ""))
    axis.set_xlabel(f"generation of {plan.population} strings")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.grid(visible=True)
    axis.set_axisbelow(True)
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def best_so_far(evolution: Evolution) -> list[float]:
    """The best fitness up to each generation; NaN if all have failed."""
    better = min if evolution.plan.minimise else max
    found: list[float] = []
    for best in evolution.logbook.select("best"):
        known = [one for one in (*found[-1:], best) if one == one]
        found.append(better(known) if known else best)
    return found
