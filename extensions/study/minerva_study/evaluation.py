"""The score of a string: the fitness of its runs, computed in worker processes and cached."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.in_process import never
from minerva_bus.launch.specs import load
from minerva_bus.launch.world_files import WorldFile
from minerva_bus.settings.world_settings import AS_WRITTEN, Overrides
from minerva_bus.user_code import place_of
from minerva_study.domains import extent
from minerva_study.outcome import Outcome
from minerva_study.sent_world import spec_of
from minerva_study.trial import prepared, run_trial
from minerva_study.worker_pool import Result, TaskPool

Fitness = Callable[[Outcome], float]


@dataclass(frozen=True, slots=True)
class Score:
    """The mean fitness of a string's trials; NaN with an error if one failed.

    `digest` is that of the final string of the first trial.
    """

    fitness: float
    digest: str = ""
    error: str = ""

    @property
    def failed(self) -> bool:
        """Whether a trial failed."""
        return bool(self.error)


@dataclass(frozen=True, slots=True)
class Evaluator:
    """Runs worlds: `trials` per string, with the world's seed, the next one, and so on.

    In the workers of an executor, trials `read` the world.
    """

    file: WorldFile
    fitness: Fitness
    pool: TaskPool
    trials: int = 1
    in_process: bool = False
    read: Callable[[Overrides], WorldFile] | None = None

    def evaluate(self, strings: Sequence[Scene], on_score: Callable[[int, Score], None]) -> None:
        """Evaluate strings; each score is reported with the number of its string as it arrives.

        Raises KeyboardInterrupt; scores that were reported before remain valid.
        """
        # Trials of different strings finish in any order.
        open_trials = {n: dict[int, Result]() for n in range(len(strings))}

        def on_result(number: int, result: Result) -> None:
            n, trial = divmod(number, self.trials)
            results = open_trials[n]
            results[trial] = result
            if len(results) == self.trials:
                on_score(n, _score([results[k] for k in range(self.trials)]))

        # `on_result` relies on this order: the trials of a string are neighbours.
        tasks = [self._trial(scene, k) for scene in strings for k in range(self.trials)]
        self.pool.run(tasks, on_result)

    def _prepared(self, _: Overrides) -> WorldFile:
        return self.file

    def _trial(self, string: Scene, trial: int) -> StringTrial:
        read = self.read or self._prepared
        seed = self.file.world.seed + trial
        # By its name, because the scheduler of Dask unpickles tasks, too, and has no user code.
        fitness = self.fitness if self.read is None else spec_of(self.fitness) or self.fitness
        return StringTrial(read, string, seed, fitness, self.in_process)


@dataclass(frozen=True, slots=True)
class StringTrial:
    """The run of a world with another string and seed.

    `fitness` may be `module:function`, which a worker loads after it has found the world's modules.
    """

    read: Callable[[Overrides], WorldFile]
    string: Scene
    seed: int
    fitness: Fitness | str
    in_process: bool

    @property
    def label(self) -> str:
        """Names the run in messages."""
        return f"seed {self.seed} of the string {self.string!s:.60}"

    def __call__(self, interrupted: Callable[[], bool] = never) -> Mapping[str, Any]:
        """Run and compute the fitness; returns plain data. Raises MinervaError."""
        file = prepared(self.read(AS_WRITTEN))
        world = replace(file.world, scene=self.string, seed=self.seed)
        fitness = load(self.fitness) if isinstance(self.fitness, str) else self.fitness
        return run_fitness(replace(file, world=world), fitness, self.in_process, interrupted)


def run_fitness(
    file: WorldFile,
    fitness: Fitness,
    in_process: bool,
    interrupted: Callable[[], bool] = never,
) -> Mapping[str, Any]:
    """Run a world and compute its fitness; returns plain data. Raises MinervaError."""
    outcome = run_trial(file, in_process, interrupted)
    name = getattr(fitness, "__name__", "fitness")
    try:
        returned = fitness(outcome)
    except MinervaError:
        raise
    except Exception as error:
        # One line, because equal errors of several strings are counted.
        place = place_of(error)
        where = "" if place is None else f" at {place.where}"
        raise MinervaError(f"{name} raised {error!r}{where}") from error
    try:
        value = float(returned)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not math.isfinite(value):
        raise MinervaError(f"{name} returned {returned!r:.60}; expected a finite number")
    return {"fitness": value, "digest": outcome.digest}


def _score(results: Sequence[Result]) -> Score:
    error = next((result.error for result in results if result.error), "")
    if error:
        return Score(math.nan, error=error)
    values = [float(result.values["fitness"]) for result in results]
    # `fsum` is exact, so the mean does not depend on the order of trials.
    return Score(math.fsum(values) / len(values), str(results[0].values["digest"]))


@dataclass(frozen=True, slots=True)
class Evaluated:
    """A string and its score."""

    scene: Scene
    score: Score


@dataclass(slots=True)
class EvaluationCache:
    """Evaluates each string once, because the same string always has the same score.

    `on_done` is called for each result, also for those from the cache.
    """

    evaluator: Evaluator
    minimise: bool = False
    on_done: Callable[[], None] = lambda: None
    known: dict[bytes, Evaluated] = field(default_factory=dict[bytes, Evaluated])
    best: Evaluated | None = None

    def __call__(self, strings: Sequence[Scene], random: Sequence[Scene] = ()) -> list[Score]:
        """The scores of strings, and of `random` ones that cannot become the best."""
        scenes = [*strings, *random]
        # Worlds are deterministic, so a string with the same digest would have the same score.
        new = list({s.digest: s for s in scenes if s.digest not in self.known}.values())
        eligible = {scene.digest for scene in strings}
        # Progress counts strings with a known score, too, so that it reaches its total.
        for _ in range(len(scenes) - len(new)):
            self.on_done()

        def on_score(number: int, score: Score) -> None:
            scene = new[number]
            evaluated = self.known[scene.digest] = Evaluated(scene, score)
            if scene.digest in eligible:
                # At once, so that an interrupted evaluation leaves the best string so far.
                self._compare(evaluated)
            self.on_done()

        before = self.best
        self.evaluator.evaluate(new, on_score)
        # Runs end in any order, but of equal strings the first one wins with any number of workers.
        self.best = before
        # A string may be known from random search, for which it was not eligible.
        for scene in strings:
            self._compare(self.known[scene.digest])
        return [self.known[scene.digest].score for scene in scenes]

    @property
    def failures(self) -> list[Evaluated]:
        """The strings whose worlds failed."""
        failed = [entry for entry in self.known.values() if entry.score.failed]
        return sorted(failed, key=lambda entry: (entry.score.error, str(entry.scene)))

    def _compare(self, evaluated: Evaluated) -> None:
        """Keep the best string; of equal ones the shorter, then the first."""
        if self.best is None or self._rank(evaluated) > self._rank(self.best):
            self.best = None if evaluated.score.failed else evaluated

    def _rank(self, evaluated: Evaluated) -> tuple[float, int]:
        return merit(evaluated.score, self.minimise), -extent(evaluated.scene).nodes


def merit(score: Score, minimise: bool) -> float:
    """A score as a number of which more is better."""
    if score.failed:
        return -math.inf
    return -score.fitness if minimise else score.fitness
