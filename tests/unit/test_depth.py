"""No function recurses: strings may be nested as deeply as memory allows."""

import copy
import tracemalloc

import pytest

from minerva_bus import (
    Agent,
    EventType,
    Geometry,
    Primitive,
    Transformation,
    Vocabulary,
    evolve,
    interpret,
    on,
    parse,
    view,
    visualize,
)
from minerva_bus.errors import GrammarError, VocabularyError
from minerva_bus.grammar.scene import Scene, agents, scene_of
from minerva_bus.testing.strategies import with_unique_ids

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
