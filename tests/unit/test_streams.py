"""Random numbers: one stream per (seed, id, frame), for one agent, a population and machine code."""

import math

import numpy as np
import pytest

from minerva_bus import Agent, EventType, Frame, Vocabulary, evolve, on
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.ids import Ids
from minerva_bus.portable import distributions as d
from minerva_bus.portable import log
from minerva_bus.portable.distributions import GAMMA, MASK, mixed_one, standard_normal
from minerva_bus.world.context import Rng, RngBatch, Streams, hash_of, stream

KEY = 0x0123456789ABCDEF
NAMES = [f"a{number}" for number in range(40)]


def units(word, count):
    """The uniform numbers after a state of SplitMix64: upper 53 bits of each mixed word."""
    return [(mixed_one((word + (step + 1) * GAMMA) & MASK) >> 11) / 2**53 for step in range(count)]


def state(name):
    return mixed_one(hash_of(name) ^ KEY)


FIRST, SECOND, THIRD = units(state("a0"), 3)
NORMAL = standard_normal(FIRST, SECOND)
DRAWS = [
    ("random", (), FIRST),
    ("uniform", (), FIRST),
    ("uniform", (2.0,), 2 + (1 - 2) * FIRST),
    ("uniform", (2.0, 5.0), 2 + 3 * FIRST),
    ("integers", (10,), int(10 * FIRST)),
    ("integers", (5, 1000), 5 + int(995 * FIRST)),
    ("integers", (-7, -6), -7),
    ("exponential", (), -log(1 - FIRST)),
    ("exponential", (3.0,), -3 * log(1 - FIRST)),
    ("normal", (), NORMAL),
    ("normal", (2.0, 0.5), 2 + 0.5 * NORMAL),
    ("chance", (FIRST,), False),
    ("chance", (math.nextafter(FIRST, 1),), True),
    ("chance", (0.0,), False),
    ("chance", (1.0,), True),
]


@pytest.mark.parametrize(("name", "parameters", "expected"), DRAWS)
def test_a_draw_is_what_its_definition_says(name, parameters, expected):
    rng = Rng.of(hash_of("a0"), KEY)
    drawn = getattr(rng, name)(*parameters)
    assert drawn == expected
    assert type(drawn) is type(expected)
    # A normal number takes two draws; all others take one.
    assert rng.random() == (THIRD if name == "normal" else SECOND)


@pytest.mark.parametrize(("name", "parameters", "expected"), DRAWS)
def test_a_population_draws_the_same(name, parameters, expected):
    batch = Streams(Ids.of(NAMES), KEY).batch()
    drawn = getattr(batch, name)(*parameters)
    assert drawn.shape == (len(NAMES),)
    assert drawn[0] == expected
    alone = [getattr(Rng.of(hash_of(agent), KEY), name)(*parameters) for agent in NAMES]
    assert drawn.tolist() == alone


@pytest.mark.parametrize(("low", "high"), [(0, None), (3, 3), (4, 3), (-1, None)])
def test_an_empty_range_has_no_integer(low, high):
    for rng in (Rng(1), RngBatch(np.array([1, 2], np.uint64))):
        with pytest.raises(MisuseError, match="no integer is in"):
            rng.integers(low, high)
    batch = RngBatch(np.array([1, 2], np.uint64))
    with pytest.raises(MisuseError, match="no integer is in"):
        batch.integers(np.array([0, 5]), np.array([1, 5]))
    assert batch.integers(np.array([0, 5]), np.array([1, 6])).tolist() == [0, 5]


def test_single_draws_and_batches_continue_the_same_streams():
    """In any mixture: each stream has one order of numbers."""
    expected = {name: units(state(name), 4) for name in NAMES}
    for ids in (Ids.of(NAMES), NAMES):
        streams = Streams(ids, KEY)
        assert streams.row(3).random() == expected["a3"][0]
        assert streams.row(3) is streams.row(3)
        second = streams.batch().random()
        assert [second[3], second[4]] == [expected["a3"][1], expected["a4"][0]]
        # After a batch, a single draw continues it.
        assert streams.row(4).random() == expected["a4"][1]
        some = streams.batch(np.array([4, 7]))
        assert some.random().tolist() == [expected["a4"][2], expected["a7"][1]]
        # A part of a part advances its own streams only.
        assert some.of(np.array([1])).random().tolist() == [expected["a7"][2]]
        assert some.of(None).random().tolist() == [expected["a4"][3], expected["a7"][3]]


def test_many_single_draws_are_those_of_the_batch():
    streams = Streams(Ids.of(NAMES), KEY)
    assert [streams.row(row).random() for row in range(40)] == [
        units(state(n), 1)[0] for n in NAMES
    ]


def test_an_adopted_stream_continues_where_it_is():
    streams, rng = Streams(Ids.of(NAMES), KEY), Rng.of(hash_of("a5"), KEY)
    rng.random()
    streams.adopt(5, rng)
    assert streams.batch().random()[5] == units(state("a5"), 2)[1]


@pytest.mark.parametrize(
    ("draw", "parameters", "expected", "count"),
    [
        (d.draw_random, (), FIRST, 1),
        (d.draw_uniform, (2.0, 5.0), 2 + 3 * FIRST, 1),
        (d.draw_integers, (5, 1000), 5 + int(995 * FIRST), 1),
        (d.draw_chance, (FIRST,), False, 1),
        (d.draw_chance, (math.nextafter(FIRST, 1),), True, 1),
        (d.draw_exponential, (-3.0,), -3 * log(1 - FIRST), 1),
        (d.draw_normal, (2.0, 0.5), 2 + 0.5 * NORMAL, 2),
    ],
)
def test_machine_code_has_the_same_definition(draw, parameters, expected, count):
    words = np.array([1, state("a0"), 3], np.uint64)
    assert draw(words, 1, *parameters) == expected
    assert words.tolist() == [1, (state("a0") + count * GAMMA) & MASK, 3]


eRoll = EventType("eRoll")


class Die(Agent, symbol="ADie"):
    roll: float = 0.0
    second: float = 0.0

    @on("eRoll")
    def throw(self, event, moment):
        self.roll, self.second = moment.random.random(), moment.random.random()


W = Vocabulary.of(eRoll, Die).read("ADie#a · ADie#b · ADie#c(ADie#d)")


def rolls(w, frame):
    from minerva_bus.grammar.scene import agents

    return {agent.id: agent.values for agent in agents(evolve(w, [eRoll()], [Die], frame).scene)}


def test_the_same_key_gives_the_same_numbers():
    assert stream(1, "#a", 2).random(5).tolist() == stream(1, "#a", 2).random(5).tolist()


def test_any_other_key_gives_others():
    keys = [(1, "#a", 2), (2, "#a", 2), (1, "#b", 2), (1, "a", 2), (1, "#a", 3), (12, "#a", 2)]
    drawn = {tuple(stream(*key).random(3)) for key in keys}
    assert len(drawn) == len(keys)


def test_the_numbers_are_those_of_every_platform():
    """A change here invalidates existing records."""
    assert stream(7, "#a", 0).integers(0, 1000, 4).tolist() == [41, 149, 316, 979]


def test_words_are_those_of_the_published_generator():
    """Reference values of Vigna's splitmix64.c for the seed 1234567."""
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    states = [(1234567 + (step + 1) * d.GAMMA) & d.MASK for step in range(3)]
    assert [d.mixed_one(state) for state in states] == published
    words = np.array(states, np.uint64)
    assert d.mixed_many(words).tolist() == published
    units = [d.unit_one(state) for state in states]
    assert d.unit_many(words).tolist() == units == [(word >> 11) / 2**53 for word in published]


def test_agents_roll_the_same_alone_and_in_company_and_in_any_order():
    together = rolls(W, Frame(3, seed=9))
    assert len(set(together.values())) == 4
    for node in W.nodes:
        alone = rolls(type(W)((node,)), Frame(3, seed=9))
        assert alone == {who: together[who] for who in alone}
    assert rolls(type(W)(W.nodes[::-1]), Frame(3, seed=9)) == together


def test_seeds_and_frames_matter_and_other_generators_do_not():
    np.random.seed(0)
    before = rolls(W, Frame(3, seed=9))
    np.random.seed(1)
    assert rolls(W, Frame(3, seed=9)) == before
    assert rolls(W, Frame(4, seed=9)) != before
    assert rolls(W, Frame(3, seed=10)) != before


def test_several_draws_of_one_agent_go_on_in_one_stream():
    again = rolls(W, Frame(3, seed=9))["a"]
    assert again[0] != again[1]
    assert again == tuple(stream(9, "#a", 3).random(2))
