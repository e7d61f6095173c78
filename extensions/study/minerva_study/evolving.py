"""Evolution of strings: `evolve` as a function, which shares its study with `minerva evolve`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

from minerva_bus.api.world import World, request_of, world_of
from minerva_bus.collect.data_tables import DataTable
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.assignment import places
from minerva_bus.launch.console import Console
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.world_settings import Overrides
from minerva_study.domains import Extent
from minerva_study.evaluation import EvaluationCache, Evaluator, Fitness
from minerva_study.evolution import Evolution, Generation, Plan
from minerva_study.executor_pool import ExecutorSource, Workers, open_pool
from minerva_study.mutation.mutable import Targets, parse_targets
from minerva_study.mutation.mutator import LONGEST, Mutator
from minerva_study.results import ResultTable
from minerva_study.studies import sent_world
from minerva_study.study_tables import data_table
from minerva_study.trial import prepared

MAX_NODES = 1000


@dataclass(frozen=True, slots=True)
class EvolutionRun:
    """An evolution that has ended, with the strings that were evaluated."""

    evolution: Evolution
    cache: EvaluationCache
    interrupted: bool


@dataclass(frozen=True, slots=True)
class EvolutionStudy:
    """How strings evolve.

    `mutable` are targets as of `minerva evolve --mutable`, none: everything. `nodes`: maximum size
    of a string. `trials`: runs per string.
    """

    fitness: Fitness
    plan: Plan
    mutable: Sequence[str] = ()
    nodes: int = MAX_NODES
    trials: int = 1
    in_process: bool = True

    def run(
        self,
        file: WorldFile,
        workers: Workers,
        console: Console,
        read: Callable[[Overrides], WorldFile] | None = None,
    ) -> EvolutionRun:
        """Evolve the string of a prepared world; Ctrl-C ends it early.

        The workers of an executor `read` the world. Raises MisuseError for targets that match
        nothing, and MinervaError if no world can run.
        """
        targets = parse_targets(tuple(self.mutable), file.world.vocabulary)
        _check_targets(targets, tuple(self.mutable), file, console)
        mutator = Mutator(targets, Extent(self.nodes, LONGEST.depth))
        interrupted = False
        name = file.world.name
        with open_pool(workers, lambda line: console.log(name, line, "warning")) as pool:
            evaluator = Evaluator(file, self.fitness, pool, self.trials, self.in_process, read)
            cache = EvaluationCache(evaluator, self.plan.minimise)
            evolution = Evolution(file.world.scene, mutator, self.plan, cache)
            cache.on_done = EvolutionProgress(console, name, cache, self.plan.evaluations)
            try:
                for generation in evolution.run():
                    console.note(_line(generation, evolution.random))
            # Strings that have been evaluated are a valid result.
            except KeyboardInterrupt:
                interrupted = True
        console.end()
        return EvolutionRun(evolution, cache, interrupted)


@dataclass(frozen=True)
class EvolvedStrings:
    """The result of an evolution.

    Attributes:
        scene: the best string, and its `fitness`; `digest` is that of its run's last string.
        generations: a table with the best, median and worst fitness of each generation.
        strings: a table with a row for each string, as of `minerva evolve -o strings.csv`.

    """

    scene: Scene
    fitness: float
    digest: str
    generations: DataTable
    strings: DataTable


def evolve_strings(
    world: World | str | Path,
    fitness: Fitness,
    *,
    population: int = 20,
    generations: int = 10,
    mutable: Sequence[str] = (),
    frames: int | None = None,
    seed: int | None = None,
    minimise: bool = False,
    trials: int = 1,
    nodes: int = MAX_NODES,
    workers: int = 0,
    limit: float = 60.0,
    executor: ExecutorSource | None = None,
    quiet: bool = False,
    **options: Any,
) -> EvolvedStrings:
    """Evolve the string of a world by a genetic algorithm; needs the extra `evolve`.

    Args:
        world: a `World`, a world file, or the name of an installed world.
        fitness: a function of the outcome of a run (`scene`, `frames`, `digest`, `events`,
            `figures`) that returns a number.
        population: strings per generation.
        generations: after the first.
        mutable: targets that may mutate: SYMBOL, #ID, A/B.NAME=LOW:HIGH; default: everything.
        frames: per run; default: the world's own.
        seed: of the worlds and of the evolution; default: the world's own.
        minimise: whether less is better.
        trials: runs per string, with seed, seed + 1, ...
        nodes: maximum number of nodes of a string.
        workers: parallel runs; 0: one per core.
        limit: seconds that a run may take; 0: no limit.
        executor: runs the strings, as in `sweep`; `fitness` has to be in a module.
        quiet: show no progress.
        options: the world's own options.

    Raises:
        MisuseError: an argument is wrong, or no string could be evaluated.
        KeyboardInterrupt: after Ctrl-C.

    Example:
        >>> best = evolve_strings(world, lambda run: run.events["eBerry"], frames=200)
        >>> best.scene, best.fitness

    """
    # Without pacing: a study runs as fast as possible.
    own = world_of(world, {})
    request = request_of(own, options, frames=frames, seed=seed, rate=0.0)
    file = prepared(request.file)
    plan = Plan(population, generations, file.world.seed, minimise)
    study = EvolutionStudy(fitness, plan, mutable, nodes, trials)
    read = None if executor is None else sent_world(own, request.overrides, fitness)
    console = Console(quiet=quiet, world=file.world.name)
    ran = study.run(file, Workers(workers, limit, executor), console, read)
    return _evolved(ran)


def _evolved(ran: EvolutionRun) -> EvolvedStrings:
    """The best string. Raises MisuseError if there is none, and KeyboardInterrupt."""
    # `minerva evolve` reports the partial result; a function either returns or raises.
    if ran.interrupted:
        raise KeyboardInterrupt
    best = ran.cache.best
    if best is None:
        why = ran.cache.failures[0].score.error if ran.cache.failures else "there was none"
        raise MisuseError(f"no string could be evaluated; the first: {why}")
    names = tuple(field.name for field in fields(Generation))
    rows = tuple(astuple(row) for row in ran.evolution.log)
    generations = data_table("generations", ResultTable(names[:1], names, rows))
    strings = data_table("strings", ran.evolution.table())
    score = best.score
    return EvolvedStrings(best.scene, score.fitness, score.digest, generations, strings)


def _check_targets(
    targets: Targets, texts: tuple[str, ...], file: WorldFile, console: Console
) -> None:
    """Report targets that match nothing in the string. Raises MisuseError if none matches."""
    idle = targets.idle(places(file.world.scene, LONGEST.depth))
    if idle and len(idle) == len(texts):
        raise MisuseError(
            f"--mutable {', '.join(texts)}: the world's string has no match: nothing may change"
        )
    for number in idle:
        console.note(f"--mutable {texts[number]}: the world's string has no match yet")


class EvolutionProgress:
    """The status line: the number of evaluated strings, and the best fitness so far."""

    def __init__(self, console: Console, name: str, cache: EvaluationCache, total: int) -> None:
        self._console = console
        self._name = name
        self._cache = cache
        self._total = total
        self._done = 0

    def __call__(self) -> None:
        self._done += 1
        best = self._cache.best
        shown = "" if best is None else f"  best {best.score.fitness:.6g}"
        rest = f"strings{shown}  Ctrl-C stops"
        self._console.progress(self._name, self._done, self._total, rest)


def _line(row: Generation, random: list[float]) -> str:
    failed = f", {row.failed} failed" if row.failed else ""
    search = f"; random search {random[-1]:.6g}" if random else ""
    return (
        f"generation {row.generation}: best {row.best:.6g}, median {row.median:.6g},"
        f" worst {row.worst:.6g}{failed}{search}"
    )
