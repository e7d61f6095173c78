"""Values set in a string: by symbol, id and place, typed, and with explained mistakes."""

import numpy as np
import pytest

from minerva_bus import Agent, Degrees, Primitive, Transformation, Vocabulary
from minerva_bus.errors import MisuseError
from minerva_bus.grammar.mutation.assignment import assigned, names_nodes, parameter_of

PStone = Primitive("PStone", size=float, name=str)
TAim = Transformation("TAim", angle=Degrees)


class Fox(Agent, symbol="AFox"):
    speed: float = 1.0
    age: int = 0
    shy: bool = False


WORDS = Vocabulary.of(Fox, PStone, TAim)
SCENE = WORDS.read(
    'AFox#a(TAim<angle=10>(PStone<size=1, name="x">) · AFox#b) · PStone<size=2, name="y">'
    ' · AFox#c-1<age=3>(PStone<size=3, name="z">)'
)


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        # Agents within agents have the value too, and keep what is around them.
        (["AFox.speed=2"], [("<speed=1,", "<speed=2,", 3)]),
        (["#c-1.age=4"], [("age=3", "age=4", 1)]),
        (["AFox#b.shy=true"], [("AFox#b<speed=1, age=0, shy=false>",
                                "AFox#b<speed=1, age=0, shy=true>", 1)]),
        (["AFox/PStone.size=9"], [("size=3", "size=9", 1)]),
        (["#a/TAim/PStone.size=1e-05"], [("size=1,", "size=1e-05,", 1)]),
        (["TAim.angle=1.5707963267948966rad"], [("angle=10", "angle=90", 1)]),
        (["PStone.name=a=b.c, d"], [(f'name="{n}"', 'name="a=b.c, d"', 1) for n in "xyz"]),
        # The later of two values for one parameter counts.
        (["PStone.size=5", "AFox/PStone.size=6"],
         [("size=1,", "size=5,", 1), ("size=2,", "size=5,", 1), ("size=3,", "size=6,", 1)]),
    ],
)  # fmt: skip
def test_the_named_nodes_get_the_value(texts, expected):
    wanted = str(SCENE)
    for old, new, count in expected:
        assert wanted.count(old) == count, wanted
        wanted = wanted.replace(old, new)
    assert str(assigned(SCENE, WORDS, texts)) == wanted


def test_a_population_in_columns_stays_in_columns():
    foxes = Fox.many("f", 100, age=np.arange(100))
    made = assigned(foxes, WORDS, ["AFox.speed=2.5", "#f7.age=1000"])
    assert len(made.pieces) == 1
    ages = [agent.state["age"] for agent in made]
    assert ages == [1000 if age == 7 else age for age in range(100)]
    assert {agent.state["speed"] for agent in made} == {2.5}


def test_keys_of_nodes_are_told_from_those_of_processes():
    of_nodes = ["AFox.speed", "#a.speed", "*/PStone.size", "AFox#b.shy", "AFox/TAim.angle"]
    assert all(map(names_nodes, of_nodes))
    assert not any(map(names_nodes, ["weather.amount", "AFox", "Anna.rate", "speed", "a-1.x"]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("AFix.speed=1", "no AFix; did you mean 'AFox'"),
        ("AFox.sped=1", "AFox has no 'sped'; did you mean 'speed'"),
        ("#c-2.age=1", "no agent #c-2; did you mean 'c-1'"),
        ("#c-1.aeg=1", "no 'aeg'; did you mean 'age'"),
        ("PStone/AFox.age=1", "the world's string has no PStone/AFox; it has AFox, PStone, TAim"),
        ("*.size=1", "expected a symbol or #ID before .size"),
        ("AFox.age=1.5", "AFox.age=1.5: expected a whole number"),
        ("AFox.speed=fast", "AFox.speed=fast: expected"),
        ("AFox.shy=2", "AFox.shy=2: expected"),
        ("TAim.angle=2kg", "TAim.angle=2kg: expected"),
        ("AFox.speed=", "AFox.speed=: expected"),
    ],
)
def test_mistakes_are_explained(text, says):
    with pytest.raises(MisuseError) as error:
        assigned(SCENE, WORDS, [text])
    assert says in str(error.value)


def test_a_parameter_knows_its_domain():
    parameter = parameter_of("AFox.age", SCENE, WORDS)
    assert (parameter.domain("1:5").low, parameter.domain("1,3").values) == (1, (1, 3))
    with pytest.raises(MisuseError, match=r"AFox.age=0.5:2: expected a whole number"):
        parameter.domain("0.5:2")
