"""Mutations: allowed targets, bounds, and the effect of each operator."""

from typing import Literal

import numpy as np
import pytest

from minerva_bus.errors import MisuseError
from minerva_bus.grammar.fields import Default, Fields
from minerva_bus.grammar.scene import walk
from minerva_bus.grammar.types import Degrees
from minerva_bus.grammar.vocabulary import AgentKind, Primitive, Transformation, Vocabulary
from minerva_bus.launch.assignment import places
from minerva_study.domains import Extent, Interval, OneOf, extent
from minerva_study.mutation import operators as op
from minerva_study.mutation.mutable import parse_targets
from minerva_study.mutation.mutator import Mutator
from minerva_study.mutation.naming import copy_id, new_id
from minerva_study.mutation.nodes import ids_of

VOCABULARY = Vocabulary.of(
    Primitive("PEye", left=Default(float, 0.0)),
    Transformation("TAim", angle=Degrees),
    AgentKind("ABug", Fields.of({"legs": Default(int, 4), "gait": Literal["walk", "run", "hop"]})),
    AgentKind("AStone", Fields.of({"name": str})),
)
BUGS = VOCABULARY.read(
    'ABug#a<gait="walk">(TAim<angle=40>(PEye) · TAim<angle=-40>(PEye)) · AStone#s<name="x">'
    ' · ABug#b<gait="run">() · PEye'
)
LIMIT = Extent(50, 6)


def targets(*texts):
    return parse_targets(texts, VOCABULARY)


def mutants(mutator, count=300, string=BUGS):
    chance = np.random.default_rng(1)
    return [mutator.mutated(string, chance).scene for _ in range(count)]


def values(string, symbol, name):
    return [
        node.values[node.names.index(name)]
        for opens, node in walk(string)
        if opens and node.symbol == symbol
    ]


def one(operator, *texts, seed=0, string=BUGS):
    chance = np.random.default_rng(seed)
    return operator(op.Material(string, targets(*texts), LIMIT, chance, lambda w, _: w))


# --- allowed targets ---


def test_only_what_is_named_changes():
    for w in mutants(Mutator(targets("TAim/PEye.left=-1:2"))):
        inner, outer = values(w, "PEye", "left")[:2], values(w, "PEye", "left")[2:]
        assert all(-1 <= value <= 2 for value in inner)
        assert outer == [0.0]
        assert w != BUGS
        assert values(w, "TAim", "angle") == [40.0, -40.0]


def test_an_agent_is_named_by_its_id():
    for text in ("#b.legs", "ABug#b.legs=0:9"):
        for w in mutants(Mutator(targets(text)), 50):
            assert values(w, "ABug", "legs")[0] == 4
            assert 0 <= values(w, "ABug", "legs")[1] <= 9 or "=" not in text


def test_bounds_have_units_and_choices_are_of_the_type():
    assert targets("TAim.angle=-1rad:90deg").all[0].domain == Interval(-57.29577951308232, 90.0)
    assert targets("ABug.gait=walk, hop").all[0].domain == OneOf(("walk", "hop"))
    assert targets("ABug.legs=2,4,6").all[0].domain == OneOf((2, 4, 6))
    assert targets('AStone.name="a,b","c"').all[0].domain == OneOf(("a,b", "c"))
    assert targets("AStone.name=a,b").all[0].domain == OneOf(("a", "b"))
    drawn = {values(w, "ABug", "legs")[0] for w in mutants(Mutator(targets("ABug.legs=2,4,6")))}
    assert drawn == {2, 4, 6}


def test_a_word_becomes_another_of_its_words():
    drawn = {values(w, "ABug", "gait")[0] for w in mutants(Mutator(targets("ABug#a.gait")))}
    assert drawn == {"run", "hop"}


def test_nodes_that_may_go_leave_the_others_alone():
    kept = Mutator(targets("PEye"), LIMIT)
    for w in mutants(kept):
        assert ids_of(w) == {"a", "b", "s"}
        assert values(w, "TAim", "angle") == [40.0, -40.0]
    assert len({extent(w).nodes for w in mutants(kept)}) > 1


def test_a_norm_that_forbids_every_change_stops_all():
    assert mutants(Mutator(targets("AStone.name")), 3) == [BUGS] * 3
    assert mutants(Mutator(targets("TAim/TAim")), 3) == [BUGS] * 3


def test_unknown_targets_are_distinguished_from_future_ones():
    texts = (
        "#b.legs",
        "#c",
        "#b.left",
        "TAim/PEye.left",
        "TAim/AStone",
        "PEye/PEye.left",
        "#s.name",
    )
    assert targets(*texts).idle(places(BUGS, 50)) == [1, 2, 5]
    assert targets("PEye", "PEye/PEye.left").idle(places(BUGS, 50)) == []
    assert targets().idle(places(BUGS, 50)) == []


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("ABut", "did you mean 'ABug'"),
        ("ABug.leg", "has no 'leg'; did you mean 'legs'"),
        ("ABug=3", "values need a parameter"),
        ("ABug.legs=9:2", "a lower end that is at most the upper"),
        ("ABug.legs=2.5", "a whole number"),
        ("ABug.gait=walk,swim", "one of walk, run, hop"),
        ("TAim.angle=1m:2m", "a number in deg"),
        ("TAim.angle=x:y", "a value of the type real deg"),
        ("*.legs=1:2", "bounds need the symbol"),
        ("ABug#a b", "not a valid agent id"),
        ("", "no "),
        ("/PEye", "no "),
    ],
)
def test_an_invalid_target_is_rejected_in_one_line(text, problem):
    with pytest.raises(MisuseError, match=problem) as raised:
        targets(text)
    assert "\n" not in str(raised.value)


# --- operators ---


def test_perturb_changes_one_parameter_and_names_it():
    made = one(op.perturb, "PEye.left=0:1")
    assert made.how.startswith("PEye.left 0 → ")
    assert sum(value != 0.0 for value in values(made.scene, "PEye", "left")) == 1


def test_a_copy_has_an_id_of_its_own():
    made = one(op.duplicate, "ABug#a")
    assert ids_of(made.scene) == {"a", "a-2", "b", "s"}
    again = one(op.duplicate, "ABug#a-2", string=made.scene)
    assert ids_of(again.scene) == {"a", "a-2", "a-3", "b", "s"}
    assert extent(again.scene).nodes == extent(BUGS).nodes + 2 * 5


def test_swap_changes_places_and_nothing_else():
    seen = {str(made.scene) for n in range(40) if (made := one(op.swap, "ABug", seed=n))}
    (swapped,) = seen
    w = VOCABULARY.read(swapped)
    assert [node.symbol for node in w] == ["ABug", "AStone", "ABug", "PEye"]
    assert [w.nodes[0].id, w.nodes[2].id] == ["b", "a"]


def test_nodes_within_one_another_do_not_change_places():
    nested = VOCABULARY.read("TAim<angle=1>(TAim<angle=2>(PEye))")
    assert all(one(op.swap, "TAim", seed=n, string=nested) is None for n in range(20))


def test_the_last_node_of_a_world_stays():
    single = VOCABULARY.read("PEye")
    assert all(one(op.delete, seed=n, string=single) is None for n in range(20))


def test_crossing_takes_a_node_of_the_same_symbol():
    other = VOCABULARY.read('ABug#a<gait="hop", legs=6>(PEye<left=9>)')
    chance = np.random.default_rng(0)
    given = op.Material(BUGS, targets("ABug"), LIMIT, chance, lambda w, _: w)
    made = op.cross(given, other)
    assert made.how == "ABug#a from the other parent"
    assert 6 in values(made.scene, "ABug", "legs")
    assert VOCABULARY.check(made.scene) == made.scene
    blended = op.blend(given, other)
    assert values(blended.scene, "ABug", "legs")[1] == 4


def test_new_and_copied_ids():
    assert copy_id("fox", set()) == "fox"
    assert copy_id("fox", {"fox"}) == "fox-2"
    assert copy_id("fox-2", {"fox", "fox-2"}) == "fox-3"
    assert new_id("AFox", {"fox1"}) == "fox2"


def test_places_are_in_the_order_of_the_text():
    assert [place.path for place in places(BUGS, 9)] == [
        (0,), (0, 0), (0, 0, 0), (0, 1), (0, 1, 0), (1,), (2,), (3,),
    ]  # fmt: skip
    assert all(place.depth <= 2 for place in places(BUGS, 2))


def test_scattered_strings_keep_to_their_bounds():
    mutator = Mutator(targets("TAim.angle=0:10", "PEye.left=5:6"))
    chance = np.random.default_rng(2)
    for _ in range(50):
        w = mutator.scattered(BUGS, chance).scene
        assert all(0 <= value <= 10 for value in values(w, "TAim", "angle"))
        assert all(5 <= value <= 6 for value in values(w, "PEye", "left"))
