"""Evolution of strings (the paper's section 5): mutation, crossover and selection.

A generation has as many children as parents; the best of both are the next parents. Random numbers
come from streams keyed by (seed, purpose, generation), and scores count in the order of birth. So
the champion does not depend on the number of workers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from minerva_bus.grammar.scene import Scene
from minerva_bus.world.context import stream
from minerva_study.domains import extent
from minerva_study.evaluation import Score, merit
from minerva_study.mutation.mutator import Mutator, Stream
from minerva_study.mutation.operators import Mutant
from minerva_study.results import ResultTable

CROSSOVER_RATE: Final = 0.4
"""Share of the children with two parents."""

REPEAT_RATE: Final = 0.3
"""Probability that another mutation follows a mutation."""

TOURNAMENT: Final = 3
"""Number of individuals of which the best one becomes a parent."""

COLUMNS: Final = (
    *("number", "generation", "parents", "mutations", "nodes", "fitness", "digest", "string"),
    "error",
)
"""Of the table of all strings."""

Evaluate = Callable[[Sequence[Scene], Sequence[Scene]], Sequence[Score]]
"""Scores of the children, followed by those of the strings of random search."""


@dataclass(frozen=True, slots=True)
class Individual:
    """A string with its parents, its mutations and its score.

    `rank` orders individuals: fitness, then the shorter string, then the older one.
    """

    number: int
    generation: int
    scene: Scene
    parents: tuple[int, ...]
    how: str
    score: Score
    rank: tuple[float, int, int]


@dataclass(frozen=True, slots=True)
class Generation:
    """The fitness of a generation's children (NaN if all failed), and how many failed."""

    generation: int
    best: float
    median: float
    worst: float
    failed: int


@dataclass(frozen=True, slots=True)
class Plan:
    """Size and seed of an evolution; `minimise`: less is better."""

    population: int = 20
    generations: int = 10
    seed: int = 0
    minimise: bool = False
    compare_random: bool = False

    @property
    def evaluations(self) -> int:
        """The number of strings to evaluate."""
        return self.population * (self.generations + 1) * (2 if self.compare_random else 1)


@dataclass(frozen=True, slots=True)
class _Birth:
    parents: tuple[int, ...]
    made: Mutant


@dataclass(slots=True)
class Evolution:
    """An evolution that begins with the string `first`.

    `all` are all individuals by number, `population` the current parents, best first, and `log` the
    generations. `random` is the best fitness so far of a random search with as many evaluations.
    """

    first: Scene
    mutator: Mutator
    plan: Plan
    evaluate: Evaluate
    all: list[Individual] = field(default_factory=list[Individual])
    population: list[Individual] = field(default_factory=list[Individual])
    random: list[float] = field(default_factory=list[float])
    log: list[Generation] = field(default_factory=list[Generation])

    def run(self) -> Iterator[Generation]:
        """Run all generations; yields each one when its scores are known."""
        for generation in range(self.plan.generations + 1):
            births = self._children(generation) if generation else self._founders()
            drawn = self._random_strings(generation) if self.plan.compare_random else []
            scores = self.evaluate([birth.made.scene for birth in births], drawn)
            self._select(generation, births, scores[: len(births)])
            self._add_random(scores[len(births) :])
            yield self.log[-1]

    @property
    def champion(self) -> Individual | None:
        """The best individual, None if all have failed."""
        best = max(self.all, key=lambda individual: individual.rank, default=None)
        return None if best is None or best.score.failed else best

    def table(self) -> ResultTable:
        """All individuals in the order of their birth; parents are their numbers."""
        rows = [
            (
                *(each.number, each.generation, " ".join(map(str, each.parents)), each.how),
                *(extent(each.scene).nodes, None if each.score.failed else each.score.fitness),
                *(each.score.digest, str(each.scene), each.score.error or None),
            )
            for each in self.all
        ]
        return ResultTable(COLUMNS[:1], COLUMNS, tuple(rows))

    def ancestors(self, of: Individual) -> list[Individual]:
        """An individual and its ancestors, the youngest first."""
        wanted, line = {of.number}, list[Individual]()
        for individual in reversed(self.all[: of.number + 1]):
            if individual.number in wanted:
                line.append(individual)
                wanted.update(individual.parents)
        return line

    # --- births ---

    def _founders(self) -> list[_Birth]:
        """The first string, and random variants of it."""
        others = self._scattered("founder", 1, 0)
        return [_Birth((), made) for made in (Mutant(self.first, "the first"), *others)]

    def _random_strings(self, generation: int) -> list[Scene]:
        return [made.scene for made in self._scattered("draw", 0, generation)]

    def _scattered(self, purpose: str, begin: int, generation: int) -> list[Mutant]:
        """Random variants of the first string."""
        return [
            self.mutator.scattered(self.first, stream(self.plan.seed, f"{purpose} {n}", generation))
            for n in range(begin, self.plan.population)
        ]

    def _children(self, generation: int) -> list[_Birth]:
        """Children of parents that win tournaments, drawn with replacement."""
        # All draws of a generation come from one array, the children's from a stream each, so no
        # draw depends on the result of another child.
        rng = stream(self.plan.seed, "selection", generation)
        shape = (self.plan.population, 2, TOURNAMENT)
        # The population is sorted, so the smallest index wins.
        winners: list[list[int]] = (
            rng.integers(len(self.population), size=shape).min(axis=2).tolist()
        )
        return [
            self._child(n, generation, self.population[a], self.population[b])
            for n, (a, b) in enumerate(winners)
        ]

    def _child(self, n: int, generation: int, first: Individual, second: Individual) -> _Birth:
        rng = stream(self.plan.seed, f"child {n}", generation)
        parents, scene, steps = (first.number,), first.scene, list[str]()
        # A string crossed with itself gains nothing; tournaments draw with replacement.
        if second.number != first.number and rng.random() < CROSSOVER_RATE:
            crossed = self.mutator.crossed(scene, second.scene, rng)
            if crossed.how:
                parents, scene = (first.number, second.number), crossed.scene
                steps = [crossed.how]
        # Without a crossover a mutation is certain: a copy of the parent would only repeat its
        # score.
        if not steps or rng.random() < 0.5:
            scene, mutations = self._mutated(scene, rng)
            steps += mutations
        return _Birth(parents, Mutant(scene, "; ".join(steps)))

    def _mutated(self, scene: Scene, rng: Stream) -> tuple[Scene, list[str]]:
        steps: list[str] = []
        while not steps or rng.random() < REPEAT_RATE:
            made = self.mutator.mutated(scene, rng)
            scene = made.scene
            steps.append(made.how)
        return scene, [how for how in steps if how]

    # --- scores ---

    def _select(self, generation: int, births: Sequence[_Birth], scores: Sequence[Score]) -> None:
        """Add the children of a generation, and keep the best of them and their parents."""
        children: list[Individual] = []
        for number, (birth, score) in enumerate(zip(births, scores, strict=True), len(self.all)):
            made = birth.made
            # Numbers are unique, so the order is total and the selection does not depend on the
            # sort.
            rank = merit(score, self.plan.minimise), -extent(made.scene).nodes, -number
            children.append(
                Individual(number, generation, made.scene, birth.parents, made.how, score, rank)
            )
        self.all += children
        everybody = sorted([*self.population, *children], key=lambda i: i.rank, reverse=True)
        self.population = everybody[: self.plan.population]
        fine = sorted(score.fitness for score in scores if not score.failed)
        best, worst = (0, -1) if self.plan.minimise else (-1, 0)
        fine = fine or [math.nan]
        middle, failed = fine[len(fine) // 2], sum(score.failed for score in scores)
        self.log.append(Generation(generation, fine[best], middle, fine[worst], failed))

    def _add_random(self, scores: Sequence[Score]) -> None:
        if not scores:
            return
        best = min if self.plan.minimise else max
        fine = [score.fitness for score in scores if not score.failed]
        # The series is the best so far, also over a generation in which all have failed.
        fine += [value for value in self.random[-1:] if not math.isnan(value)]
        self.random.append(best(fine, default=math.nan))
