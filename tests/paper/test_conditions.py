"""e^d_c of section 3.2: only agents that satisfy an event's condition process it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import Agent, EventType, Vocabulary, evolve, on
from minerva_bus.errors import UserCodeError, VocabularyError
from minerva_bus.frame.member_side import Host
from minerva_bus.frame.messages import EvolveRequest, Fragments
from minerva_bus.grammar.condition import holds, holds_of_many, parse_condition
from minerva_bus.wire.strings_codec import Reader, plain_event
from minerva_bus.world.context import Frame
from minerva_bus.world.evolution import Policy

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
        ("energy > 5 or heat < 0", True),
        ("energy > 5 or heat > 0", False),
        ("energy > 5 and heat < 0 or awake == true", True),
        ("energy > 5 and (heat < 0 or awake == true)", False),
        ("not energy > 5", True),
        ("not (energy > 2 and awake == true)", False),
        ("not not awake == true", True),
        ("energy > heat", True),
        ("2 < energy", True),
        ("energy > name", False),
        ("energy == missing or energy == 3", False),
        ("not missing == 0", False),
        ("not way == 1", False),
        ("distance(energy, heat, 0, 2.5) == 5", True),
        ("distance(energy, heat, 0, 2.5) < 5", False),
        ("5 >= distance(0, 2.5, energy, heat) and energy > 2", True),
        ("distance( energy,heat , energy, -1.5 ) < heat", False),
        ("distance(energy, heat, 0, 0) > distance(0, heat, 0, 0)", True),
        ("distance(energy, name, 0, 0) > 0", False),
        ("not distance(missing, heat, 0, 0) > 0", False),
        ("distance(energy, awake, 0, 0) > 0", False),
        ("distance(energy, heat, 0, 0) > awake", False),
        ("distance == 3", False),
    ],
)
def test_rules_that_hold(condition, expected):
    assert holds(condition, STATE) is expected


@pytest.mark.parametrize(
    ("condition", "column"),
    [
        ("energy", 7),
        ("energy >", 9),
        ("energy > 1 xor heat < 0", 12),
        ("energy > 1 and", 15),
        ("energy > 1 or and heat < 0", 15),
        ("energy = 1", 8),
        ("1 < 2", 2),
        ("(energy > 1", 12),
        ("energy > 1)", 11),
        ("not", 4),
        ("energy > 1 < 2", 12),
        (r'name == "\q"', 9),
        ("energy > __import__('os')", 20),
        ("energy > 1; energy", 11),
        ("distance(energy, heat, 0) < 1", 25),
        ("distance(energy, heat, 0, 0, 0) < 1", 28),
        ('distance(energy, "a", 0, 0) < 1', 18),
        ("distance(distance(energy, heat, 0, 0), 0, 0, 0) < 1", 10),
        ("distance(energy, heat, 0, 0)", 29),
        ("distance(1, 2, 3, 4) < 5", 21),
        ('distance(energy, heat, 0, 0) < "a"', 29),
        ("energy + 1 > 2", 8),
        ("(" * 40 + "energy > 1" + ")" * 40, 34),
        ("not " * 40 + "energy > 1", 133),
        ("energy > 1 or " * 400 + "energy > 1", 4001),
    ],
)
def test_invalid_conditions(condition, column):
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


def test_the_condition_is_about_the_agent_when_it_processes_the_event():
    hit = eHit(10, condition="energy < 10")
    assert "energy=11" in evolved("AFox#a<energy=1>", hit, hit)


def test_numbers_of_numpy_that_lambda_assigned_count_as_numbers():
    events = [eSet(), eHit(1, condition="energy == 7 and heat == 2.5")]
    assert "energy=8" in evolved("AFox#a", *events)


def test_a_condition_knows_attributes_and_nothing_else():
    """An agent's id is not an attribute of its state; events have receivers for this purpose."""
    assert "energy=0" in evolved("AFox#a", eHit(1, condition='id == "a"'))


# --- checks against the vocabulary, wherever events enter ---

WRONG = [
    ("enrgy > 2", "Fox has no enrgy; did you mean 'energy'", 1),
    ("energy > 2 and nme == 3", "Fox has no nme", 16),
    ('energy == "a"', "energy of AFox is a number, which cannot be compared with a text", 1),
    ("awake == name", "awake of AFox is true or false, which cannot be compared with a text", 1),
    ("energy > 1 and was.energy < 2", "AFox has no was.energy", 16),
    ("#b.energy > 1", "AFox has no #b.energy", 1),
]


@pytest.mark.parametrize(("condition", "message", "column"), WRONG)
def test_a_condition_that_no_agent_can_fulfil_is_refused(condition, message, column):
    with pytest.raises(VocabularyError, match="member x: condition.*" + message) as caught:
        VOCABULARY.check_event(eHit(1, condition=condition), "member x")
    assert caught.value.column == column
    assert str(caught.value).endswith("^")
    with pytest.raises(VocabularyError, match=message):
        VOCABULARY.check_any(eHit(np.array([1, 2]), condition=condition))


def test_it_concerns_kinds_that_respond_to_the_event():
    class Dog(Agent, symbol="ADog"):
        teeth: int = 0

        @on("eSet")
        def set(self, event, moment):
            self.teeth = 1

    both = Vocabulary.of(eHit, eSet, Fox, Dog)
    both.check_event(eSet(condition="teeth == 1"))
    both.check_event(eSet(condition="energy == 1"))
    with pytest.raises(VocabularyError, match="AFox has no teeth"):
        both.check_event(eHit(1, condition="teeth == 1"))
    with pytest.raises(VocabularyError, match=r"condition:1:16: ADog has no energy|has no teeth"):
        both.check_event(eSet(condition="teeth == 1 and energy == 1"))
    Vocabulary.of(eHit).check_event(eHit(1, condition="whatever == 1"))


def test_it_is_refused_in_messages():
    reader = Reader(VOCABULARY)
    for event in (eHit(1, condition="enrgy > 1"), eHit(np.array([1]), condition="enrgy > 1")):
        with pytest.raises(VocabularyError, match="AFox has no enrgy"):
            reader.event(plain_event(event))


def test_a_rejected_event_names_its_sender():
    class Caller(Agent, symbol="AFox"):
        energy: int = 0

        @on("eHit")
        def call(self, event, moment):
            moment.emit(eHit(1, condition="enrgy > 1"))

    vocabulary = Vocabulary.of(eHit, Caller)
    host = Host("host", {"AFox": Caller})
    host.take(Fragments({"a": vocabulary.read("AFox#a")}))
    with pytest.raises(UserCodeError, match=r"Caller\.call: #a: condition:1:1: AFox has no"):
        host.answer(EvolveRequest(0, ("host",), (eHit(1),)), Frame(), Policy.SEQUENTIAL, vocabulary)


STATES = {"a": st.integers(-3, 3), "b": st.floats(-3, 3), "c": st.booleans(), "d": st.text("xy")}
atoms = st.one_of(
    st.tuples(st.sampled_from("ab"), st.sampled_from(["<", ">=", "=="]), st.sampled_from("ab12")),
    st.tuples(st.just("c"), st.sampled_from(["==", "!="]), st.sampled_from(["true", "c", "d"])),
    st.tuples(st.just('"x"'), st.sampled_from(["<", "!="]), st.sampled_from(["d", '"y"', "d"])),
).map(" ".join)
conditions = st.recursive(
    atoms.filter(lambda text: text.count('"') < 4),
    lambda inner: st.one_of(
        inner.map("not {}".format),
        inner.map("({})".format),
        st.tuples(inner, st.sampled_from([" and ", " or "]), inner).map("".join),
    ),
    max_leaves=6,
)


@given(conditions, st.lists(st.fixed_dictionaries(STATES), min_size=1, max_size=5))
def test_of_many_it_holds_as_of_each(condition, states):
    dtypes = {"a": np.int64, "b": np.float64, "c": np.bool_, "d": object}
    arrays = {name: np.array([state[name] for state in states], t) for name, t in dtypes.items()}
    assert holds_of_many(condition, arrays, len(states)).tolist() == [
        holds(condition, state) for state in states
    ]
