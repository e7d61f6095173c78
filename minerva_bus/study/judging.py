"""How good a string is: a fitness of what its worlds come to, all at once in processes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from minerva_bus.errors import MinervaError
from minerva_bus.grammar.scene import Scene
from minerva_bus.launch.worldfile import WorldFile
from minerva_bus.study.crew import Result, Task, WorkerPool
from minerva_bus.study.outcome import Outcome
from minerva_bus.study.trial import run_trial

Fitness = Callable[[Outcome], float]


@dataclass(frozen=True, slots=True)
class Score:
    """How good a string was, the mean of its trials; NaN where one failed, with the error.

    `digest` is that of the first trial's last string.
    """

    fitness: float
    digest: str = ""
    error: str = ""

    @property
    def failed(self) -> bool:
        """Whether a trial failed."""
        return bool(self.error)


@dataclass(frozen=True, slots=True)
class Judge:
    """Runs worlds of strings: `trials` of each, with the world's seed, the one after it, ...

    Raises KeyboardInterrupt where that comes; scores heard by then stay heard.
    """

    file: WorldFile
    fitness: Fitness
    crew: WorkerPool
    trials: int = 1
    in_process: bool = False

    def judge(self, strings: Sequence[Scene], heard: Callable[[int, Score], None]) -> None:
        """Judge some strings; each score is heard as it comes, with its string's number."""
        open_trials = {n: dict[int, Result]() for n in range(len(strings))}

        def result(number: int, one: Result) -> None:
            n, trial = divmod(number, self.trials)
            open_trials[n][trial] = one
            if len(open_trials[n]) == self.trials:
                heard(n, _score([open_trials[n][k] for k in range(self.trials)]))

        self.crew.run([self._task(w, k) for w in strings for k in range(self.trials)], result)

    def _task(self, string: Scene, trial: int) -> Task:
        world = self.file.world
        file = replace(self.file, world=replace(world, scene=string, seed=world.seed + trial))
        return lambda: judged(file, self.fitness, self.in_process)


def judged(file: WorldFile, fitness: Fitness, in_process: bool) -> Mapping[str, Any]:
    """Run a world and judge it; plain data. Raises MinervaError."""
    outcome = run_trial(file, in_process)
    name = getattr(fitness, "__name__", "fitness")
    try:
        found = float(fitness(outcome))
    except MinervaError:
        raise
    except Exception as error:
        raise MinervaError(f"{name} raised {error!r}") from error
    if not math.isfinite(found):
        raise MinervaError(f"{name} returned {found}; expected a finite number")
    return {"fitness": found, "digest": outcome.digest}


def _score(results: Sequence[Result]) -> Score:
    error = next((one.error for one in results if one.error), "")
    if error:
        return Score(math.nan, error=error)
    values = [float(one.told["fitness"]) for one in results]
    return Score(math.fsum(values) / len(values), str(results[0].told["digest"]))
