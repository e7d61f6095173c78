"""The public comparison of agent-based frameworks: times and lines of code.

    python -m benchmarks.comparison --size small large --systems minerva mesa mason
        --models wolf_sheep flocking schelling forest_fire [--runs 100] [--turns 4]
        [--mason CLONE/mason.22.jar] [--json]
    python -m benchmarks.comparison --size crowd --systems minerva mesa mesa-frames
        --models wolf_sheep flocking_at_once wealth --runs 3 [--mesa-frames PYTHON]

The models and parameters are those of JuliaDynamics/ABMFrameworksComparison: 100 steps (Schelling:
20), and the median time of seeded runs. The systems take turns, so they share the load of the
machine. `mason` needs Java and the path of its jar in a clone of that repository, which has the
sources of the models beside it; the jar is not part of this project. mesa-frames may need other
versions of libraries: give the interpreter of an environment that has it. It has few models, and
the others are left out.

`ms` is the median of creating and running the model (MASON: of running it). `ratio` is the time
relative to the row of `minerva`.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from benchmarks.command import Option, Table, options
from benchmarks.comparison.parameters import MODELS, PARAMETERS, PUBLIC, SIZES
from benchmarks.comparison.systems import System, Unavailable, system

SYSTEMS: Final = ("minerva", "mesa", "mason", "mesa-frames")
COLUMNS: Final = {
    "system": "<11", "model": "<16", "size": "<6", "runs": ">5", "ms": ">10.1f", "ratio": ">9.2f",
    "lines": ">6",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table; without a row of `minerva` there is no ratio."""

    system: str
    model: str
    size: str
    runs: int
    ms_median: float
    ratio: float | None
    lines: int


def measured(
    names: list[str], model: str, size: str, runs: int, turns: int, paths: Mapping[str, Path | None]
) -> list[Row]:
    """The rows of systems, which take turns."""
    systems: dict[str, System] = {}
    times: dict[str, list[float]] = {}

    def leave_out(name: str, reason: Unavailable) -> None:
        print(f"{name}: {model} left out: {reason}", file=sys.stderr)
        if name in systems:
            systems.pop(name).close()
            times.pop(name, None)

    for name in names:
        try:
            systems[name] = system(name, model, size, paths)
        except Unavailable as reason:
            leave_out(name, reason)
    try:
        for turn in range(turns):
            seeds = range(1 + turn, 1 + runs, turns)
            for name, each in list(systems.items()) if seeds else ():
                try:
                    results = each.run(seeds)
                    times.setdefault(name, []).extend(result["ms"] for result in results)
                except Unavailable as reason:
                    leave_out(name, reason)
        medians = {name: statistics.median(values) for name, values in times.items()}
        ours = medians.get("minerva")
        return [
            Row(
                name,
                model,
                size,
                len(times[name]),
                median,
                median / ours if ours else None,
                systems[name].lines(),
            )
            for name, median in medians.items()
        ]
    finally:
        for each in systems.values():
            each.close()


def main() -> None:
    """Measure, and print a table."""
    arguments = options(
        __doc__,
        size=Option(["small", "large"], choices=SIZES),
        systems=Option(["minerva", "mesa", "mason"], choices=SYSTEMS),
        models=Option(list(PUBLIC), choices=MODELS),
        runs=Option(100, "seeded runs of each system"),
        turns=Option(4, "in which the systems alternate"),
        mason=Option(Path, "its jar in a clone of the comparison"),
        mesa_frames=Option(Path, "the interpreter of an environment that has it"),
    )
    table = Table(COLUMNS, as_json=arguments.json)
    paths = {"mason": arguments.mason, "mesa-frames": arguments.mesa_frames}
    for model in arguments.models:
        for size in [size for size in arguments.size if (model, size) in PARAMETERS]:
            for row in measured(
                arguments.systems, model, size, arguments.runs, arguments.turns, paths
            ):
                table.row(asdict(row))


if __name__ == "__main__":
    main()
