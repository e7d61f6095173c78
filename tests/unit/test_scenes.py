"""Strings as values: nodes, assigned values, and any depth without recursion."""

import copy
import pickle
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest

from minerva_bus import (
    EMPTY,
    Agent,
    Degrees,
    EventType,
    Geometry,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    evolve,
    interpret,
    on,
    parse,
    view,
    visualize,
)
from minerva_bus.errors import GrammarError, MisuseError, VocabularyError
from minerva_bus.grammar.scene import (
    FigureNode,
    TransformationNode,
    agents,
    identities,
    rebuild,
    scene_of,
    walk,
    with_scope,
)
from minerva_bus.grammar.text_and_digest import scene_digest
from minerva_bus.launch.assignment import assigned, names_nodes
from minerva_bus.testing.strategies import with_unique_ids


def figure(value):
    return FigureNode("PA", ("x",), (value,))


@pytest.mark.parametrize(
    ("first", "other", "same"),
    [
        (1, 1.0, True),
        (1, True, False),
        (0.0, -0.0, False),
        (0, -0.0, False),
        ("1", 1, False),
        ("true", True, False),
        ((1,), (1.0,), True),
        ((), "", False),
        (np.array([[0.0]]), np.array([[-0.0]]), False),
        (np.array([[0]], np.int16), np.array([[0.0]]), False),
        (np.zeros((2, 3), np.int16), np.zeros((3, 2), np.int16), False),
        (np.zeros((0, 3), np.int16), np.zeros((0, 2), np.int16), False),
        (np.zeros((2, 3), np.int16), np.zeros((2, 3), np.int16), True),
        (parse("PA"), parse("PA"), True),
        (EMPTY, "", False),
    ],
)
def test_nodes_and_strings_are_equal_when_they_print_the_same(first, other, same):
    a, b = figure(first), figure(other)
    assert (a == b) is same
    assert (scene_of(a) == scene_of(b)) is same
    assert (str(scene_of(a)) == str(scene_of(b))) is same
    assert not same or hash(a) == hash(b)


def test_matrices_with_zeros_of_both_signs_read_back():
    w = scene_of(figure(np.array([[0.0, -0.0, -0.0, 0.0]])))
    assert str(w) == "PA<x=1x4r[0 -0.0*2 0]>"
    assert parse(str(w)) == w


def test_an_agent_is_no_figure_of_the_same_text():
    assert parse("PA").nodes[0] != parse("TA()").nodes[0]
    assert parse("TA()").nodes[0] != parse("AA#a()").nodes[0]
    assert parse("PA").nodes[0] != "PA"


def test_digests_are_those_of_the_documentation():
    """An independent implementation: records and other implementations depend on these digests."""
    from hashlib import blake2b

    def h(data):
        return blake2b(data, digest_size=16).digest()

    inner = h(h(b"PB\0"))
    cells = h(np.array([[0, 0], [1, 2]], "<i2").tobytes()).hex()
    outer = h(b"TA<x=1.5>\0" + inner) + h(f"PC<m=2x2[#{cells}]>\0".encode())
    assert parse("TA<x=1.5>(PB) · PC<m=2x2[0*2 1 2]>").digest == h(outer)
    assert EMPTY.digest == h(b"")


def test_digests_that_are_kept_are_those_of_the_string():
    w = parse("TA(AB(PC · TD()) · PC) · TD()")
    part = w.nodes[0].scope.digest  # computed before that of the whole string
    assert part == parse("AB(PC · TD()) · PC").digest
    assert w.digest == scene_digest(parse(str(w)))
    twice = rebuild(w, lambda node, scope: scene_of(node, node) if node.symbol == "PC" else node)
    assert twice.digest == scene_digest(parse(str(twice)))


def test_strings_do_not_change():
    w = parse("TA(PB)")
    with pytest.raises(AttributeError):
        w.nodes = ()
    with pytest.raises(AttributeError):
        w.nodes[0].scope = EMPTY


def test_copies_and_pickles():
    w = parse('TA<x=[1, "a"], m=1x2[1 2]>(AB#b<w={PC}>)')
    assert copy.copy(w) == copy.deepcopy(w) == pickle.loads(pickle.dumps(w)) == w


def test_walk_opens_and_closes():
    assert [(opens, node.symbol) for opens, node in walk(parse("PA · TB(PC · TD())"))] == [
        (True, "PA"),
        (True, "TB"),
        (True, "PC"),
        (True, "TD"),
        (False, "TD"),
        (False, "TB"),
    ]


def test_rebuild_and_agents_skip_the_given_nodes():
    w = parse("TA(AB#b(AC#c)) · AC#d")
    known = identities(w.nodes[0].scope)
    assert [agent.id for agent in agents(w)] == ["b", "c", "d"]
    assert [agent.id for agent in agents(w, known)] == ["d"]
    left = []
    rebuild(w, lambda node, scope: left.append(node.symbol) or node, known)
    assert left == ["AB", "TA", "AC"]


def test_rebuild_shares_what_stays():
    w = parse("TA(TB(PC) · PD) · TB(PC)")
    assert rebuild(w, lambda node, scope: with_scope(node, scope) if scope else node) is w

    def leave(node, scope):
        if node.symbol == "PD":
            return EMPTY
        return with_scope(node, scope) if isinstance(node, TransformationNode) else node

    changed = rebuild(w, leave)
    assert str(changed) == "TA(TB(PC)) · TB(PC)"
    assert changed.nodes[1] is w.nodes[1]
    assert changed.nodes[0].scope.nodes[0] is w.nodes[0].scope.nodes[0]


def test_a_string_is_a_sequence_of_nodes():
    w = parse("PA · PB")
    assert len(w) == 2
    assert [node.symbol for node in w] == ["PA", "PB"]
    assert not EMPTY
    assert Scene(()) == EMPTY
    assert repr(w) == "Scene(PA · PB)"


def test_the_core_can_be_imported_without_docstrings():
    # Without them, dataclasses show their defaults while modules are still being imported.
    words = [sys.executable, "-OO", "-c", "import minerva_bus.grammar.scene"]
    subprocess.run(words, check=True)


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
        ("#c-2.age=1", "no agent #c-2; did you mean '#c-1'"),
        ("#c-1.aeg=1", "no 'aeg'; did you mean 'age'"),
        ("PStone/AFox.age=1", "the world's string has no PStone/AFox; it has AFox, PStone, TAim"),
        ("*.size=1", "expected a symbol or #ID before .size"),
        ("*#c-1.age=1", "expected a symbol or #ID before .age"),
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


DEPTH = 10_000
PDot = Primitive("PDot")
TIn = Transformation("TIn")
eAdd = EventType("eAdd")
eWrap = EventType("eWrap")
eDraw = EventType("eDraw", visual=True)


class Box(Agent, symbol="ABox"):
    n: int = 0

    @on("eAdd")
    def add(self, event, moment):
        self.n += 1

    @on("eWrap")
    def wrap(self, event, moment):
        return TIn()(self.string)

    @view("eDraw")
    def picture(self, event):
        return TIn()(self.scope)


VOCABULARY = Vocabulary.of(PDot, TIn, eAdd, eWrap, eDraw, Box)
TEXT = "TIn(ABox(" * DEPTH + "PDot" + "))" * DEPTH


@pytest.fixture(scope="module")
def deep():
    return VOCABULARY.read(TEXT)


def test_parse_print_and_check(deep):
    assert VOCABULARY.read(str(deep)) == deep
    assert VOCABULARY.check(deep) is deep
    assert len(list(agents(deep))) == DEPTH


def test_compare_hash_and_digest(deep):
    other = VOCABULARY.read(TEXT.replace("PDot", "PDot · PDot"))
    assert deep == VOCABULARY.read(TEXT)
    assert deep != other
    assert hash(deep) != hash(other)
    assert deep.nodes[0] == VOCABULARY.read(TEXT).nodes[0]


def test_evolve(deep):
    evolved = evolve(deep, [eAdd()], [Box]).scene
    assert all(agent.state["n"] == 1 for agent in agents(evolved))
    assert evolve(deep, [eAdd(receivers=["nobody"])], [Box]).scene is deep
    wrapped = evolve(deep, [eWrap()], [Box]).scene
    assert str(wrapped).count("TIn(") == 2 * DEPTH


def test_visualize_and_interpret(deep):
    class Depth(Geometry):
        now = most = 0

        def enter(self, transformation):
            self.now += 1
            self.most = max(self.most, self.now)

        def leave(self, transformation):
            self.now -= 1

    geometry = Depth()
    interpret(visualize(deep, [eDraw()], [Box]), geometry)
    assert (geometry.now, geometry.most) == (0, 2 * DEPTH)


def test_show_and_forget(deep):
    """repr shortens, and the last reference to a deep string can be dropped."""
    assert len(repr(deep)) < 300
    assert len(repr(deep.nodes[0])) < 300
    copy.copy(deep)
    parse(TEXT)
    with_unique_ids(deep + scene_of(*deep.nodes))


def test_errors_within(deep):
    with pytest.raises(GrammarError, match=r"scope of ABox is not closed"):
        parse(TEXT[:-2])
    with pytest.raises(VocabularyError, match="no PDto"):
        VOCABULARY.read(TEXT.replace("PDot", "PDto"))


@pytest.mark.timeout(30)
def test_a_million_symbols():
    """The time-out detects quadratic growth and is far above the time of a slow machine."""
    w = parse("TIn(PDot · PDot) · PDot · " * 250_000 + "PDot")
    assert len(w) == 500_001
    assert Scene(w.nodes[:2]).digest == parse("TIn(PDot · PDot) · PDot").digest


@pytest.mark.parametrize("text", ["x" * 10**6, r"\n\"" * 10**5])
def test_a_long_text_takes_little_memory(text):
    """A pattern that remembers each character took 120 bytes for each."""
    string = f'PName<text="{text}">'
    tracemalloc.start()
    parsed = parse(string)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(parsed.nodes[0].values[0]) >= len(text) // 2
    assert most < 10 * len(string)
