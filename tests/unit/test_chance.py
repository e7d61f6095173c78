"""Random numbers: one stream per (seed, id, frame), independent of process and order."""

import numpy as np

from minerva_bus import Agent, EventType, Frame, Vocabulary, evolve, on
from minerva_bus.portable import splitmix
from minerva_bus.world.rng import stream

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
    states = [(1234567 + (step + 1) * splitmix.GAMMA) & splitmix.MASK for step in range(3)]
    assert [splitmix.mixed_one(state) for state in states] == published
    words = np.array(states, np.uint64)
    assert splitmix.mixed_many(words).tolist() == published
    units = [splitmix.unit_one(state) for state in states]
    assert (
        splitmix.unit_many(words).tolist() == units == [(word >> 11) / 2**53 for word in published]
    )


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
