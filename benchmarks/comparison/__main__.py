"""The public comparison of agent-based frameworks: times and lines of code.

    python -m benchmarks.comparison --size small large --systems minerva mesa mason agents.jl
        --models wolf_sheep flocking schelling forest_fire [--runs 100] [--turns 4]
        [--mason CLONE/mason.22.jar] [--plot FILE] [--json]
    python -m benchmarks.comparison --size crowd --systems minerva mesa mesa-frames amber
        --models wolf_sheep flocking_at_once wealth --runs 3 [--mesa-frames PYTHON]
    python -m benchmarks.comparison --size small --systems minerva mesa agentpy amber
        --models wealth flocking --runs 5 [--agentpy PYTHON] [--amber PYTHON]

The models and parameters are those of JuliaDynamics/ABMFrameworksComparison: 100 steps (Schelling:
20), and the median time of seeded runs. The systems that run here take turns, so they share the
load of the machine. `mason` needs Java and the path of its jar in a clone of that repository,
which has the sources of the models beside it; the jar is not part of this project. AgentPy, AMBER
and mesa-frames may need other versions of libraries: give the interpreter of an environment that
has one of them. They have few models, and the others are left out. Agents.jl,
Ark.jl and NetLogo do not run here: their rows have the published time relative to Agents.jl and
are marked `published`.

`ms` is the median of creating and running the model (MASON: of running it). `ratio` is the time
relative to the fastest row of `minerva`, for measured systems only. `to agents.jl` is the published
time relative to Agents.jl; for measured systems it is estimated from their time relative to Mesa
in this run and from Mesa's published time, which is of an older version on another machine.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Container, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

from benchmarks.command import PLOT, Option, Table, options
from benchmarks.comparison.parameters import MODELS, PARAMETERS, PUBLIC, SIZES
from benchmarks.comparison.published import LINES, TIMES
from benchmarks.comparison.systems import System, Unavailable, system
from benchmarks.plot import Line, plotted

MEASURED: Final = ("minerva", "mesa", "mason", "mesa-frames", "agentpy", "amber")
PUBLISHED: Final = ("agents.jl", "ark.jl", "netlogo")
COLUMNS: Final = {
    "system": "<11", "model": "<16", "size": "<6", "source": "<10", "runs": ">5", "ms": ">10.1f",
    "ratio": ">9.2f", "to agents.jl": ">13.2f", "lines": ">6",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table; times that were not measured are None."""

    system: str
    model: str
    size: str
    source: str
    runs: int = 0
    ms_median: float | None = None
    ratio: float | None = None
    to_agents_jl: float | None = None
    lines: int | None = None


def measured(
    names: list[str], model: str, size: str, runs: int, turns: int, paths: Mapping[str, Path | None]
) -> list[Row]:
    """The rows of the systems that run here, which take turns."""
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
        return [
            Row(name, model, size, "measured", len(values), statistics.median(values),
                lines=systems[name].lines())
            for name, values in times.items()
        ]  # fmt: skip
    finally:
        for each in systems.values():
            each.close()


def related(rows: list[Row]) -> list[Row]:
    """The measured rows of one model and size with their ratios."""
    time = {row.system: row.ms_median for row in rows if row.ms_median is not None}
    ours, mesa = time.get("minerva"), time.get("mesa")
    published = TIMES.get((rows[0].model, rows[0].size), {}).get("mesa") if rows else None
    return [
        replace(
            row,
            ratio=time[row.system] / ours if ours else None,
            to_agents_jl=time[row.system] / mesa * published if mesa and published else None,
        )
        for row in rows
    ]


def from_publication(model: str, size: str, names: Container[str]) -> list[Row]:
    """The published rows of some systems."""
    times = TIMES.get((model, size), {})
    return [
        Row(name, model, size, "published", to_agents_jl=time, lines=LINES[model][name])
        for name, time in times.items()
        if name in names
    ]


def lines_of(rows: list[Row]) -> list[Line]:
    """Lines of code and estimated time of each row, as points of a plot."""
    return [
        Line(f"{row.model}, {row.size}", row.system, [row.lines], [row.to_agents_jl])
        for row in rows
        if row.lines and row.to_agents_jl
    ]


def main() -> None:
    """Measure, and print a table."""
    arguments = options(
        __doc__,
        size=Option(["small", "large"], choices=SIZES),
        systems=Option(["minerva", "mesa", "mason", *PUBLISHED], choices=(*MEASURED, *PUBLISHED)),
        models=Option(list(PUBLIC), choices=MODELS),
        runs=Option(100, "seeded runs of each system"),
        turns=Option(4, "in which the systems alternate"),
        mason=Option(Path, "its jar in a clone of the comparison"),
        mesa_frames=Option(Path, "the interpreter of an environment that has it"),
        agentpy=Option(Path, "the same for AgentPy"),
        amber=Option(Path, "the same for AMBER"),
        plot=PLOT,
    )
    table, rows = Table(COLUMNS, as_json=arguments.json), list[Row]()
    paths = {
        "mason": arguments.mason,
        "mesa-frames": arguments.mesa_frames,
        "agentpy": arguments.agentpy,
        "amber": arguments.amber,
    }
    running = [name for name in arguments.systems if name in MEASURED]
    for model in arguments.models:
        for size in [size for size in arguments.size if (model, size) in PARAMETERS]:
            shown = related(measured(running, model, size, arguments.runs, arguments.turns, paths))
            shown += from_publication(model, size, set(arguments.systems) & set(PUBLISHED))
            for row in shown:
                table.row(asdict(row), *_texts(row))
            rows += shown
    if arguments.plot:
        plotted(arguments.plot, lines_of(rows), "lines of code", "time (Agents.jl = 1)")


def _texts(row: Row) -> list[object]:
    return [row.system, row.model, row.size, row.source, row.runs or None, row.ms_median, row.ratio,
            row.to_agents_jl, row.lines]  # fmt: skip


if __name__ == "__main__":
    main()
