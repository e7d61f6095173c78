"""Mutation and crossing of strings by weighted operators; the results are valid strings."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Final

import numpy as np

from minerva_bus.grammar.scene import Scene
from minerva_study.domains import Extent, extent
from minerva_study.mutation import operators as op
from minerva_study.mutation.mutable import Targets
from minerva_study.mutation.operators import Material, Mutant, Operator

Stream = np.random.Generator

OPERATORS: Final[Mapping[str, Operator]] = {
    "perturb": op.perturb,
    "replace": op.replace,
    "insert": op.insert,
    "delete": op.delete,
    "duplicate": op.duplicate,
    "swap": op.swap,
}
WEIGHTS: Final[Mapping[str, float]] = {
    "perturb": 8,
    "replace": 1,
    "insert": 1,
    "delete": 1.5,
    "duplicate": 1,
    "swap": 1,
}
LONGEST: Final = Extent(nodes=1000, depth=50)
TRIES: Final = 16
NESTED: Final = 3
"""Maximum nesting level down to which strings in values mutate."""


@dataclass(frozen=True, slots=True)
class Mutator:
    """Derives valid strings from strings that `targets.vocabulary` has checked.

    `limit` is their maximum size and depth; a string that already exceeds it does not grow. The
    weights are relative frequencies of the operators. Equal streams give equal mutants.
    """

    targets: Targets
    limit: Extent = LONGEST
    weights: Mapping[str, float] = field(default_factory=lambda: WEIGHTS)

    def mutated(self, scene: Scene, chance: Stream) -> Mutant:
        """The string with one mutation; the same string if no operator was applicable."""
        return self._mutated(scene, chance, 0)

    def crossed(self, scene: Scene, other: Scene, chance: Stream) -> Mutant:
        """The string with a part of another one; the same string if nothing fits."""
        given = self._material(scene, chance, 0)
        for _ in range(TRIES):
            crossing = op.cross if chance.random() < 0.5 else op.blend
            made = crossing(given, other)
            # An operator may find nothing to do, exceed the limit or change nothing; another try
            # may succeed.
            if made is not None and self._fits(made.scene, scene) and made.scene != scene:
                return self._checked(made)
        return Mutant(scene, "")

    def scattered(self, scene: Scene, chance: Stream) -> Mutant:
        """A random string: new values of all parameters with domains, and some mutations."""
        made = op.scatter(self._material(scene, chance, 0))
        for _ in range(int(chance.geometric(0.4))):
            made = Mutant(self.mutated(made.scene, chance).scene, made.how)
        return self._checked(made)

    def _mutated(self, scene: Scene, chance: Stream, level: int) -> Mutant:
        given = self._material(scene, chance, level)
        for _ in range(TRIES):
            made = OPERATORS[self._drawn(chance)](given)
            if made is not None and self._fits(made.scene, scene) and made.scene != scene:
                return self._checked(made)
        return Mutant(scene, "")

    def _drawn(self, chance: Stream) -> str:
        names = list(self.weights)
        ends = list(accumulate(self.weights[name] for name in names))
        return names[bisect_right(ends, chance.random() * ends[-1])]

    def _material(self, scene: Scene, chance: Stream, level: int) -> Material:
        def inner(value: Scene, stream: Stream) -> Scene:
            if level >= NESTED:
                return value
            return (
                Mutator(Targets(self.targets.vocabulary), self.limit, self.weights)
                ._mutated(value, stream, level + 1)
                .scene
            )

        return Material(scene, self.targets, self.limit, chance, inner)

    def _fits(self, made: Scene, before: Scene) -> bool:
        # A string that exceeds the limit already may change, but not grow.
        return extent(made).within(self.limit.joined(extent(before)))

    def _checked(self, made: Mutant) -> Mutant:
        return Mutant(self.targets.vocabulary.check(made.scene), made.how)
