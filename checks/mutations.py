"""Mutate strings many times and check each for validity and round trip.

    python -m checks.mutations --count 1000000

The strings use a vocabulary with every type of parameter, in lineages of 200 mutations; every tenth
mutation is a crossover with an earlier string.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from minerva_bus.errors import SceneError
from minerva_bus.grammar.fields import Default, Fields
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.types import Cells, Degrees, Metres, Reals
from minerva_bus.grammar.vocabulary import AgentKind, Primitive, Transformation, Vocabulary
from minerva_study.domains import Extent, extent
from minerva_study.mutation.mutable import Targets
from minerva_study.mutation.mutator import Mutator

LINEAGE = 200
LIMIT = Extent(nodes=40, depth=8)

Mood = Literal["calm", "hungry", "afraid"]

VOCABULARY = Vocabulary.of(
    Primitive("PDot", size=float, on=Default(bool, True)),
    Primitive("PMap", cells=Cells, heights=Reals),
    Primitive("PLine", xs=tuple[float, ...], names=tuple[str, ...]),
    Transformation("TMove", x=Metres, y=Default(Metres, 0.0)),
    Transformation("TTurn", angle=Degrees),
    AgentKind("AFox", Fields.of({"x": Metres, "mood": Default(Mood, "calm"), "births": int})),
    AgentKind("APainter", Fields.of({"action": Scene, "says": Default(str, "")})),
)
BEGIN = VOCABULARY.read(
    "PMap<cells=2x3[0*4 1 0], heights=1x2r[0.5*2]> · AFox#a<x=1, births=0>(TTurn<angle=40>("
    "PDot<size=1>)) · APainter#p<action={TMove<x=1>(PDot<size=2>)}>() · PLine<xs=[1, 2], names=[]>"
    " · TMove<x=3>(AFox#b<x=2, births=3>(AFox#c<x=0, births=0>))"
)


@dataclass(frozen=True)
class Count:
    """Numbers of mutations, unchanged strings and invalid strings; the first invalid string."""

    made: int
    same: int
    wrong: int
    first: str = ""


def mutate_many(count: int, seed: int) -> Count:
    """Mutate strings `count` times and check each."""
    mutator, chance = Mutator(Targets(VOCABULARY), LIMIT), np.random.default_rng(seed)
    string, earlier, same, wrong, first = BEGIN, BEGIN, 0, 0, ""
    for n in range(count):
        if n % LINEAGE == 0:
            string, earlier = BEGIN, string
        before = string
        crossing = n % 10 == 9
        made = (
            mutator.crossed(string, earlier, chance)
            if crossing
            else mutator.mutated(string, chance)
        )
        string = made.scene
        same += string is before
        if not is_valid(string):
            wrong += 1
            first = first or str(string)
            string = BEGIN
    return Count(count, same, wrong, first)


def is_valid(string: Scene) -> bool:
    """Whether a string is in canonical form, round-trips, and is within the size limit."""
    try:
        again = VOCABULARY.read(str(string))
    except SceneError:
        return False
    return again == string and VOCABULARY.check(string) is string and extent(string).within(LIMIT)


def main() -> None:
    """Print the counts and the duration."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=100_000)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args()
    began = time.perf_counter()
    rates = mutate_many(given.count, given.seed)
    seconds = time.perf_counter() - began
    print(
        f"{rates.made:,} mutations in {seconds:.0f} s, {rates.wrong} wrong, {rates.same} that"
        " changed nothing"
    )
    if rates.first:
        print(f"the first that is wrong: {rates.first}")
    raise SystemExit(1 if rates.wrong else 0)


if __name__ == "__main__":
    main()
