"""`minerva evolve`: evolve the string of a world and report the result."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, cast

from minerva_analysis.plotting import check_picture
from minerva_bus.cli.output import FAILED, INTERRUPTED, print_json, print_result
from minerva_bus.collect.plans import ENDINGS as TABLES
from minerva_bus.errors import MisuseError
from minerva_bus.files import ending_of
from minerva_bus.launch.console import Console
from minerva_bus.launch.specs import folder_of, load
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.world_settings import Overrides
from minerva_study.evaluation import EvaluationCache, Fitness
from minerva_study.evolution import Evolution, Plan
from minerva_study.evolution_plots import draw_fitness, draw_tree
from minerva_study.evolving import EvolutionRun, EvolutionStudy
from minerva_study.executor_pool import Workers
from minerva_study.results import write
from minerva_study.saving import WorldOptions, check_place, save
from minerva_study.sent_world import SentWorld

MAX_ERRORS: Final = 5


@dataclass(frozen=True, slots=True)
class EvolveOptions:
    """The options of the command line, without the world."""

    fitness: Fitness
    plan: Plan
    mutable: tuple[str, ...]
    nodes: int
    workers: Workers
    trials: int
    in_process: bool
    outputs: tuple[Path, ...]
    plot: Path | None
    tree: Path | None
    given: WorldOptions
    overrides: Overrides


def read_fitness(spec: str, file: WorldFile) -> Fitness:
    """Load the fitness function, `module:function`. Raises WorldFileError and MisuseError."""
    fitness = cast("Fitness", load(spec, folder_of(spec, file.path.parent)))
    if not callable(fitness):
        raise MisuseError(f"--fitness {spec} is not a function")
    return fitness


def evolve_world(file: WorldFile, wanted: EvolveOptions, console: Console, as_json: bool) -> int:
    """Evolve and print the result; returns the exit code, 1 if no string could be evaluated.

    Raises MisuseError for invalid options, and MinervaError if a world cannot run.
    """
    # Before the study, which may take hours.
    for path in wanted.outputs:
        check_place(path)
    for picture in filter(None, (wanted.plot, wanted.tree)):
        check_picture(picture)
    study = EvolutionStudy(
        wanted.fitness, wanted.plan, wanted.mutable, wanted.nodes, wanted.trials, wanted.in_process
    )
    read = None
    if wanted.workers.executor is not None:
        read = SentWorld.of(file.text, file.path, wanted.overrides, wanted.fitness)
    ran = study.run(file, wanted.workers, console, read)
    evolution, cache, interrupted = ran.evolution, ran.cache, ran.interrupted
    _save(file, wanted, console, ran)
    if as_json:
        print_json(_plain(file, evolution, cache, interrupted))
    else:
        print_result("\n".join(_lines(evolution, cache, interrupted)))
    _draw(file, wanted, console, evolution)
    return INTERRUPTED if interrupted else 0 if cache.best is not None else FAILED


def _save(file: WorldFile, wanted: EvolveOptions, console: Console, ran: EvolutionRun) -> None:
    for path in wanted.outputs:
        if ending_of(path) in TABLES:
            write(ran.evolution.table(), path)
            console.note(f"{len(ran.evolution.all)} strings are in {path}")
        elif ran.cache.best is not None:
            save(ran.cache.best.scene, path, file, wanted.given)
            # The modules that a world file names are found in its folder.
            away = ending_of(path) == ".toml" and path.resolve().parent != file.path.parent
            where = f"; to run it, move it to the folder of {file.path.name}" if away else ""
            console.note(f"best string saved to {path}{where}")


def _draw(file: WorldFile, wanted: EvolveOptions, console: Console, evolution: Evolution) -> None:
    for picture, draw in ((wanted.plot, draw_fitness), (wanted.tree, draw_tree)):
        if picture is not None and evolution.all:
            draw(evolution, file.world.name, picture)
            console.note(f"plot saved to {picture}")


def _lines(evolution: Evolution, cache: EvaluationCache, interrupted: bool) -> list[str]:
    shown = ["interrupted; the best so far:"] if interrupted else []
    errors = Counter(failure.score.error for failure in cache.failures)
    if errors:
        shown.append(f"{errors.total()} of {len(cache.known)} strings failed:")
        shown += [f"  {n} × {error}" for error, n in list(errors.items())[:MAX_ERRORS]]
    if len(errors) > MAX_ERRORS:
        shown.append(f"  and {len(errors) - MAX_ERRORS} other errors")
    if cache.best is None:
        return [*shown, "no string could be evaluated"]
    best = cache.best.score
    shown += [
        f"{len(cache.known)} strings evaluated, {len(evolution.log)} generations",
        f"fitness {best.fitness:.6g}, digest {best.digest}",
    ]
    if evolution.random:
        shown.append(f"random search at equal cost: {evolution.random[-1]:.6g}")
    return [*shown, str(cache.best.scene)]


def _plain(
    file: WorldFile, evolution: Evolution, cache: EvaluationCache, interrupted: bool
) -> dict[str, Any]:
    best = cache.best
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
            {key: _number(value) for key, value in asdict(row).items()} for row in evolution.log
        ],
        "strings": len(cache.known),
        "failed": [
            {"error": each.score.error, "string": str(each.scene)} for each in cache.failures
        ],
        "interrupted": interrupted,
    }


def _number(value: float) -> float | None:
    # NaN is the only number that differs from itself; JSON has none.
    return None if value != value else value
