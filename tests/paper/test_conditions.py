"""e^d_c of 3.2: an event is carried out only by agents that fulfil its condition."""

import numpy as np
import pytest

from minerva_bus import Agent, EventType, Vocabulary, evolve, on
from minerva_bus.errors import VocabularyError
from minerva_bus.grammar.condition import holds, parse_condition

eHit = EventType("eHit", amount=int)
eSet = EventType("eSet")


class Fox(Agent, symbol="AFox"):
    energy: int = 0
    name: str = ""
    awake: bool = False
    heat: float = 0.5

    @on("eHit")
    def hit(self, event, moment):
        self.energy += event.amount

    @on("eSet")
    def set(self, event, moment):
        self.energy, self.heat = np.int64(7), np.float32(2.5)


VOCABULARY = Vocabulary.of(eHit, eSet, Fox)
STATE = {"energy": 3, "name": 'a "b"', "awake": True, "heat": -1.5, "way": (1, 2)}


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("", True),
        ("  ", True),
        ("energy > 2", True),
        ("energy > 3", False),
        ("energy>=3", True),
        ("energy == 3.0", True),
        ("energy != 3", False),
        ("heat < -1", True),
        ("heat <= -1.5e0", True),
        ("awake == true", True),
        ("awake == false", False),
        ("awake != false", True),
        (r'name == "a \"b\""', True),
        ('name < "b"', True),
        ("energy > 2 and heat < 0 and awake == true", True),
        ("energy > 2 and heat > 0", False),
        ("missing == 0", False),
        ("missing != 0", False),
        ("way == 1", False),
        ('energy == "3"', False),
        ("name == 3", False),
        ("energy == true", False),
        ("awake == 1", False),
        ("awake > 0", False),
    ],
)
def test_what_holds(condition, expected):
    assert holds(condition, STATE) is expected


@pytest.mark.parametrize(
    ("condition", "column"),
    [
        ("energy", 1),
        ("energy >", 1),
        ("energy > 1 or heat < 0", 12),
        ("energy > 1 and", 15),
        ("energy = 1", 1),
        ("1 < energy", 1),
        ("energy > heat", 1),
        (r'name == "\q"', 9),
        ("energy > __import__('os')", 1),
    ],
)
def test_what_is_no_condition(condition, column):
    with pytest.raises(VocabularyError) as caught:
        parse_condition(condition)
    assert caught.value.column == column
    with pytest.raises(VocabularyError):
        eHit(1, condition=condition)


def test_an_event_from_outside_with_a_wrong_condition_is_refused():
    from dataclasses import replace

    with pytest.raises(VocabularyError, match="member x"):
        VOCABULARY.check_event(replace(eHit(1), condition="energy >"), "member x")


def evolved(text, *events):
    return str(evolve(VOCABULARY.read(text), events, [Fox]).scene)


def test_only_agents_that_fulfil_it_carry_it_out():
    w = "AFox#a<energy=1> · AFox#b<energy=5>"
    assert "#a<energy=1," in evolved(w, eHit(10, condition="energy > 2"))
    assert "#b<energy=15," in evolved(w, eHit(10, condition="energy > 2"))


def test_the_condition_is_of_the_agent_as_it_is_when_the_event_comes():
    one = eHit(10, condition="energy < 10")
    assert "energy=11" in evolved("AFox#a<energy=1>", one, one)


def test_numbers_of_numpy_that_lambda_assigned_count_as_numbers():
    events = [eSet(), eHit(1, condition="energy == 7 and heat == 2.5")]
    assert "energy=8" in evolved("AFox#a", *events)


def test_a_condition_knows_attributes_and_nothing_else():
    """An agent's id is no part of its state; events have receivers for that."""
    assert "energy=0" in evolved("AFox#a", eHit(1, condition='id == "a"'))
