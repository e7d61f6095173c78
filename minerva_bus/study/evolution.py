"""Evolution of strings (the paper's section 5): mutation, crossing over and selection.

A generation has as many children as parents; the best of both are the next parents. Selection
and bookkeeping are DEAP's. All chance comes from streams keyed by (seed, what for, generation),
and scores are counted in the order of birth: however many workers there are, the champion is the
same.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.mutation.mutator import Mutator
from minerva_bus.grammar.mutation.operators import Mutant
from minerva_bus.grammar.mutation.places import extent
from minerva_bus.grammar.scene import Scene
from minerva_bus.study.judging import Score
from minerva_bus.world.rng import stream

CROSSED: Final = 0.4
"""So many of the children have two parents."""

AGAIN: Final = 0.3
"""So probable it is that after a mutation there is another one."""

TOURNAMENT: Final = 3

Evaluate = Callable[[Sequence[Scene], Sequence[Scene]], Sequence[Score]]
"""Scores of the children, and behind them those of strings drawn at random."""


@dataclass(frozen=True, slots=True)
class Individual:
    """A string, whence it comes and how good it is."""

    number: int
    generation: int
    scene: Scene
    parents: tuple[int, ...]
    how: str
    score: Score
    merit: tuple[float, int, int]


@dataclass(frozen=True, slots=True)
class Plan:
    """How many strings for how long, and the seed of all chance; `minimise`: less is better."""

    population: int = 20
    generations: int = 10
    seed: int = 0
    minimise: bool = False
    random_too: bool = False

    @property
    def strings(self) -> int:
        """How many strings will be judged."""
        return self.population * (self.generations + 1) * (2 if self.random_too else 1)


@dataclass(frozen=True, slots=True)
class _Birth:
    parents: tuple[int, ...]
    made: Mutant


@dataclass(slots=True)
class Evolution:
    """An evolution from a first string on.

    `all` are all individuals by number, `logbook` has a line for each generation: best, median and
    worst fitness of its children, how many failed. `random` is the search it is compared with:
    the best so far of as many strings that are drawn without selection.
    """

    first: Scene
    mutator: Mutator
    plan: Plan
    evaluate: Evaluate
    all: list[Individual] = field(default_factory=list[Individual])
    population: list[Individual] = field(default_factory=list[Individual])
    random: list[float] = field(default_factory=list[float])
    logbook: Any = None

    def __post_init__(self) -> None:
        self.logbook = _deap().Logbook()

    def run(self) -> Iterator[int]:
        """Go on from generation to generation; each number comes when its scores are in."""
        for generation in range(self.plan.generations + 1):
            births = self._children(generation) if generation else self._founders()
            drawn = self._drawn(generation) if self.plan.random_too else []
            scores = self.evaluate([one.made.scene for one in births], drawn)
            self._count(generation, births, scores[: len(births)])
            self._count_random(scores[len(births) :])
            yield generation

    @property
    def champion(self) -> Individual | None:
        """The best so far, if any has not failed."""
        best = max(self.all, key=_merit, default=None)
        return None if best is None or best.score.failed else best

    def ancestors(self, of: Individual) -> list[Individual]:
        """An individual and those it descends from, the youngest first."""
        wanted, found = {of.number}, list[Individual]()
        for one in reversed(self.all[: of.number + 1]):
            if one.number in wanted:
                found.append(one)
                wanted.update(one.parents)
        return found

    # --- births ---

    def _founders(self) -> list[_Birth]:
        """The first string, and others drawn from all that may become of it."""
        others = [
            self.mutator.scattered(self.first, stream(self.plan.seed, f"founder {n}", 0))
            for n in range(1, self.plan.population)
        ]
        return [_Birth((), one) for one in (Mutant(self.first, "the first"), *others)]

    def _children(self, generation: int) -> list[_Birth]:
        count = self.plan.population
        with _lent(self.plan.seed, generation):
            chosen = _deap().selTournament(self.population, 2 * count, TOURNAMENT, "merit")
        pairs = zip(chosen[:count], chosen[count:], strict=True)
        return [self._child(n, generation, *pair) for n, pair in enumerate(pairs)]

    def _child(self, n: int, generation: int, one: Individual, other: Individual) -> _Birth:
        chance = stream(self.plan.seed, f"child {n}", generation)
        parents, scene, told = (one.number,), one.scene, list[str]()
        if other.number != one.number and chance.random() < CROSSED:
            crossed = self.mutator.crossed(scene, other.scene, chance)
            if crossed.how:
                parents, scene, told = (one.number, other.number), crossed.scene, [crossed.how]
        if not told or chance.random() < 0.5:
            scene, more = self._mutated(scene, chance)
            told += more
        return _Birth(parents, Mutant(scene, "; ".join(told)))

    def _mutated(self, scene: Scene, chance: Any) -> tuple[Scene, list[str]]:
        told: list[str] = []
        while not told or chance.random() < AGAIN:
            made = self.mutator.mutated(scene, chance)
            scene = made.scene
            told.append(made.how)
        return scene, [how for how in told if how]

    def _drawn(self, generation: int) -> list[Scene]:
        """What random search looks at meanwhile."""
        return [
            self.mutator.scattered(
                self.first, stream(self.plan.seed, f"draw {n}", generation)
            ).scene
            for n in range(self.plan.population)
        ]

    # --- scores ---

    def _count(self, generation: int, births: Sequence[_Birth], scores: Sequence[Score]) -> None:
        children: list[Individual] = []
        for birth, score in zip(births, scores, strict=True):
            number, scene = len(self.all) + len(children), birth.made.scene
            merit = (self._worth(score), -extent(scene).nodes, -number)
            children.append(
                Individual(number, generation, scene, birth.parents, birth.made.how, score, merit)
            )
        self.all += children
        everybody = [*self.population, *children]
        self.population = _deap().selBest(everybody, self.plan.population, "merit")
        self._log(generation, [one.score for one in children])

    def _worth(self, score: Score) -> float:
        if score.failed:
            return -math.inf
        return -score.fitness if self.plan.minimise else score.fitness

    def _log(self, generation: int, scores: Sequence[Score]) -> None:
        fine = sorted(one.fitness for one in scores if not one.failed)
        best, worst = (0, -1) if self.plan.minimise else (-1, 0)
        self.logbook.record(
            generation=generation,
            best=fine[best] if fine else math.nan,
            median=fine[len(fine) // 2] if fine else math.nan,
            worst=fine[worst] if fine else math.nan,
            failed=len(scores) - len(fine),
        )

    def _count_random(self, scores: Sequence[Score]) -> None:
        if not scores:
            return
        best = min if self.plan.minimise else max
        fine = [one.fitness for one in scores if not one.failed]
        fine += [one for one in self.random[-1:] if not math.isnan(one)]
        self.random.append(best(fine, default=math.nan))


def _merit(one: Individual) -> tuple[float, int, int]:
    """Fitness first; of equals the shorter string, and then the older one."""
    return one.merit


def _deap() -> Any:
    """DEAP's tools. Raises MisuseError where it is not installed."""
    try:
        from deap import tools  # pyright: ignore[reportMissingTypeStubs]
    except ImportError:
        raise MisuseError("evolving needs deap: pip install 'minerva-bus[evolve]'") from None
    return tools


@contextmanager
def _lent(seed: int, generation: int) -> Generator[None]:
    """DEAP draws from Python's one global generator: lend it a seed, and put back what was."""
    before = random.getstate()
    random.seed(int(stream(seed, "selection", generation).integers(1 << 62)))
    try:
        yield
    finally:
        random.setstate(before)
