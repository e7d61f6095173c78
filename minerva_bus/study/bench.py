"""A cache of evaluations: the same string in the same world always has the same score."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from minerva_bus.grammar.mutation.places import extent
from minerva_bus.grammar.scene import Scene
from minerva_bus.study.judging import Judge, Score


@dataclass(frozen=True, slots=True)
class Evaluated:
    """A string and its score."""

    scene: Scene
    score: Score


@dataclass(slots=True)
class EvaluationCache:
    """Evaluates each string once; `told` is called for each result, cached ones too."""

    judge: Judge
    minimise: bool = False
    told: Callable[[], None] = lambda: None
    known: dict[bytes, Evaluated] = field(default_factory=dict[bytes, Evaluated])
    best: Evaluated | None = None

    def __call__(self, strings: Sequence[Scene], beside: Sequence[Scene] = ()) -> list[Score]:
        """The scores of strings, in their order, and of others that cannot become the best."""
        every = [*strings, *beside]
        new = list({one.digest: one for one in every if one.digest not in self.known}.values())
        eligible = {one.digest for one in strings}
        for _ in range(len(every) - len(new)):
            self.told()

        def heard(number: int, score: Score) -> None:
            one = self.known[new[number].digest] = Evaluated(new[number], score)
            if new[number].digest in eligible:
                self._compare(one)
            self.told()

        self.judge.judge(new, heard)
        for one in strings:
            self._compare(self.known[one.digest])
        return [self.known[one.digest].score for one in every]

    @property
    def failures(self) -> list[Evaluated]:
        """The strings whose worlds failed."""
        failed = [one for one in self.known.values() if one.score.failed]
        return sorted(failed, key=lambda one: (one.score.error, str(one.scene)))

    def _compare(self, one: Evaluated) -> None:
        """Keep the best string; of equal ones the shorter, then the first."""
        if self.best is None or self._rank(one) > self._rank(self.best):
            self.best = None if one.score.failed else one

    def _rank(self, one: Evaluated) -> tuple[float, int]:
        fitness = one.score.fitness
        worth = -math.inf if one.score.failed else -fitness if self.minimise else fitness
        return worth, -extent(one.scene).nodes
