"""Mutations map L(M) into L(M), for any string, vocabulary and random stream."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from minerva_bus.grammar.scene import agents
from minerva_bus.testing.strategies import strings_of, vocabularies
from minerva_study.domains import Extent, extent
from minerva_study.mutation.mutable import Targets
from minerva_study.mutation.mutator import OPERATORS, Mutator
from minerva_study.mutation.nodes import ids_of

law = settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
SMALL = Extent(nodes=12, depth=4)

pairs = vocabularies().flatmap(
    lambda v: st.tuples(st.just(v), strings_of(v), strings_of(v), st.integers(0, 1 << 32))
)


def check(vocabulary, made, *before):
    """Check canonical form, round trip, unique ids and the size limit of a mutated string."""
    assert vocabulary.check(made) is made
    assert vocabulary.read(str(made)) == made
    assert len(ids_of(made)) == len(list(agents(made)))
    allowed = SMALL
    for string in before:
        allowed = allowed.joined(extent(string))
    assert extent(made).within(allowed)


@law
@given(pairs)
def test_a_mutated_string_is_valid(drawn):
    vocabulary, w, _, seed = drawn
    mutator = Mutator(Targets(vocabulary), SMALL)
    chance = np.random.default_rng(seed)
    for _ in range(8):
        made = mutator.mutated(w, chance).scene
        check(vocabulary, made, w)
        w = made


@law
@given(pairs, st.sampled_from(sorted(OPERATORS)))
def test_each_operator_alone_makes_valid_strings(drawn, operator):
    vocabulary, w, _, seed = drawn
    mutator = Mutator(Targets(vocabulary), SMALL, {operator: 1})
    chance = np.random.default_rng(seed)
    for _ in range(3):
        made = mutator.mutated(w, chance).scene
        check(vocabulary, made, w)
        w = made


@law
@given(pairs)
def test_crossed_and_scattered_strings_are_valid(drawn):
    vocabulary, w, v, seed = drawn
    mutator = Mutator(Targets(vocabulary), SMALL)
    chance = np.random.default_rng(seed)
    for _ in range(3):
        check(vocabulary, mutator.crossed(w, v, chance).scene, w)
        check(vocabulary, mutator.scattered(w, chance).scene, w)


@law
@given(pairs)
def test_the_same_stream_makes_the_same_mutants(drawn):
    vocabulary, w, v, seed = drawn
    mutator = Mutator(Targets(vocabulary), SMALL)

    def made():
        chance = np.random.default_rng(seed)
        return [mutator.mutated(w, chance), mutator.crossed(w, v, chance)]

    assert [(str(mutant.scene), mutant.how) for mutant in made()] == [
        (str(mutant.scene), mutant.how) for mutant in made()
    ]


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_million_mutations_are_valid():
    from checks.mutations import mutate_many

    assert mutate_many(1_000_000, seed=1).wrong == 0
