"""`minerva evolve`: evolve the string of a world and report the result."""

from __future__ import annotations

import json as json_
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from minerva_bus.cli.exit_codes import FAILED, INTERRUPTED
from minerva_bus.cli.saying import say
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.mutation.mutator import LONGEST, Mutator
from minerva_bus.grammar.mutation.places import Extent, places
from minerva_bus.grammar.mutation.targets import Targets, parse_targets
from minerva_bus.launch.console import Console
from minerva_bus.launch.specs import load
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.study.bench import EvaluationCache
from minerva_bus.study.course import draw_course
from minerva_bus.study.crew import WorkerPool
from minerva_bus.study.descent import draw_descent
from minerva_bus.study.evolution import Evolution, Plan
from minerva_bus.study.judging import Fitness, Judge
from minerva_bus.study.saving import WorldOptions, check_place, save
from minerva_bus.study.style import check_picture

SHOWN = 5


@dataclass(frozen=True, slots=True)
class EvolveOptions:
    """The options of the command line, without the world."""

    fitness: Fitness
    plan: Plan
    mutable: tuple[str, ...]
    nodes: int
    workers: int
    limit: float
    trials: int
    in_process: bool
    outputs: tuple[Path, ...]
    plot: Path | None
    tree: Path | None
    given: WorldOptions


def read_fitness(spec: str, file: WorldFile) -> Fitness:
    """Load the fitness function, `module:function`. Raises WorldFileError and MisuseError."""
    judge = cast("Fitness", load(spec, file.path.parent))
    if not callable(judge):
        raise MisuseError(f"--fitness {spec} is not a function")
    return judge


def evolve_world(file: WorldFile, wanted: EvolveOptions, console: Console, json_too: bool) -> int:
    """Evolve and print the result; returns the exit code, 1 if no string could be evaluated.

    Raises MisuseError for invalid options, and MinervaError if a world cannot run.
    """
    _check_places(wanted)
    targets = parse_targets(wanted.mutable, file.world.vocabulary)
    _check_targets(targets, wanted.mutable, file, console)
    mutator = Mutator(targets, Extent(wanted.nodes, LONGEST.depth))
    interrupted = False
    with WorkerPool(wanted.workers, wanted.limit) as crew:
        judge = Judge(file, wanted.fitness, crew, wanted.trials, wanted.in_process)
        bench = EvaluationCache(judge, wanted.plan.minimise)
        evolution = Evolution(file.world.scene, mutator, wanted.plan, bench)
        bench.told = _Progress(console, file.world.name, bench, wanted.plan.strings)
        try:
            for _ in evolution.run():
                console.note(_line(evolution))
        except KeyboardInterrupt:
            interrupted = True
    console.end()
    _save(file, wanted, console, bench)
    if json_too:
        say(json_.dumps(_plain(file, evolution, bench, interrupted)))
    else:
        say("\n".join(_lines(evolution, bench, interrupted)))
    _draw(file, wanted, console, evolution)
    return INTERRUPTED if interrupted else 0 if bench.best is not None else FAILED


def _check_targets(
    targets: Targets, texts: tuple[str, ...], file: WorldFile, console: Console
) -> None:
    """Report targets that match nothing in the string. Raises MisuseError if none matches."""
    idle = targets.idle(places(file.world.scene, LONGEST.depth))
    if idle and len(idle) == len(texts):
        raise MisuseError(
            f"--mutable {', '.join(texts)}: there is no such thing in the world's string: nothing"
            " may change"
        )
    for number in idle:
        console.note(f"--mutable {texts[number]}: there is no such thing in the world's string yet")


class _Progress:
    """The status line: the number of evaluated strings, and the best fitness so far."""

    def __init__(self, console: Console, name: str, bench: EvaluationCache, total: int) -> None:
        self._console = console
        self._name = name
        self._bench = bench
        self._total = total
        self._done = 0

    def __call__(self) -> None:
        self._done += 1
        best = self._bench.best
        shown = "" if best is None else f"  best {best.score.fitness:.6g}"
        rest = f"strings{shown}  Ctrl-C ends it"
        self._console.progress(self._name, self._done, self._total, rest)


def _check_places(wanted: EvolveOptions) -> None:
    for path in wanted.outputs:
        check_place(path)
    for picture in (wanted.plot, wanted.tree):
        if picture is not None:
            check_picture(picture)


def _save(file: WorldFile, wanted: EvolveOptions, console: Console, bench: EvaluationCache) -> None:
    for path in wanted.outputs if bench.best is not None else ():
        assert bench.best is not None
        save(bench.best.scene, path, file, wanted.given)
        away = path.suffix == ".toml" and path.resolve().parent != file.path.parent
        where = f"; its modules are found beside {file.path.name} only" if away else ""
        console.note(f"the best string is in {path}{where}")


def _draw(file: WorldFile, wanted: EvolveOptions, console: Console, evolution: Evolution) -> None:
    for picture, draw in ((wanted.plot, draw_course), (wanted.tree, draw_descent)):
        if picture is not None and evolution.all:
            draw(evolution, file.world.name, picture)
            console.note(f"{picture} is drawn")


def _line(evolution: Evolution) -> str:
    row = evolution.logbook[-1]
    failed = f", {row['failed']} failed" if row["failed"] else ""
    random = f"; random search {evolution.random[-1]:.6g}" if evolution.random else ""
    return (
        f"generation {row['generation']}: best {row['best']:.6g}, median {row['median']:.6g},"
        f" worst {row['worst']:.6g}{failed}{random}"
    )


def _lines(evolution: Evolution, bench: EvaluationCache, interrupted: bool) -> list[str]:
    shown = ["interrupted; the best so far:"] if interrupted else []
    failures = bench.failures
    counted: dict[str, int] = {}
    for failure in failures:
        error = failure.score.error
        counted[error] = counted.get(error, 0) + 1
    told = [f"  {count} × {error}" for error, count in list(counted.items())[:SHOWN]]
    if failures:
        shown += [f"{len(failures)} of {len(bench.known)} strings failed:", *told]
    if len(counted) > SHOWN:
        shown.append(f"  and {len(counted) - SHOWN} other errors")
    if bench.best is None:
        return [*shown, "no string has been judged"]
    best = bench.best.score
    shown += [
        f"{len(bench.known)} strings judged, {len(evolution.logbook)} generations",
        f"fitness {best.fitness:.6g}, digest {best.digest}",
    ]
    if evolution.random:
        shown.append(f"random search at equal cost: {evolution.random[-1]:.6g}")
    return [*shown, str(bench.best.scene)]


def _plain(
    file: WorldFile, evolution: Evolution, bench: EvaluationCache, interrupted: bool
) -> dict[str, Any]:
    best = bench.best
    return {
        "world": file.world.name,
        "seed": file.world.seed,
        "best": None
        if best is None
        else {
            "fitness": best.score.fitness,
            "digest": best.score.digest,
            "string": str(best.scene),
        },
        "first": _number(evolution.all[0].score.fitness) if evolution.all else None,
        "random": _number(evolution.random[-1]) if evolution.random else None,
        "generations": [
            {key: _number(value) for key, value in row.items()} for row in evolution.logbook
        ],
        "strings": len(bench.known),
        "failed": [
            {"error": each.score.error, "string": str(each.scene)} for each in bench.failures
        ],
        "interrupted": interrupted,
    }


def _number(value: float) -> float | None:
    return None if value != value else value
