"""Vocabularies: symbols that a world allows, and the locations of violations in a string."""

from dataclasses import replace

import numpy as np
import pytest

from minerva_bus import (
    Agent,
    AgentKind,
    Cells,
    Default,
    Degrees,
    EventType,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    parse,
    view,
)
from minerva_bus.errors import GrammarError, MisuseError, VocabularyError
from minerva_bus.grammar.scene import AgentNode, FigureNode, TransformationNode, scene_of

PMap = Primitive("PMap", cells=Default(Cells, np.zeros((1, 1), np.int16)))
PFox = Primitive("PFox")
TMove = Transformation("TMove", dist=Metres, angle=Default(Degrees, 0.0))
eHit = EventType("eHit", amount=float)
eDraw = EventType("eDraw", visual=True)


class Fox(Agent, symbol="AFox"):
    x: Metres = 0.0
    plan: Scene = Scene()
    plans: tuple[Scene, ...] = ()

    @on("eHit")
    def hit(self, event, moment): ...

    @view("eDraw")
    def picture(self, event):
        return PFox()


VOCABULARY = Vocabulary.of(PMap, PFox, TMove, eHit, eDraw, Fox)


def test_reading_types_orders_and_completes():
    w = VOCABULARY.read("TMove<angle=90°, dist=150cm>(PFox) · AFox#a · PMap")
    assert str(w) == (
        "TMove<dist=1.5, angle=90>(PFox) · AFox#a<x=0, plan={}, plans=[]>() · PMap<cells=1x1[0]>"
    )
    assert VOCABULARY.check(w) is w


def test_strings_in_attributes_are_of_the_same_world():
    w = VOCABULARY.read("AFox#a<plan={TMove<dist=50cm>(PFox)}, plans=[{PMap}]>")
    assert "plan={TMove<dist=0.5, angle=0>(PFox)}, plans=[{PMap<cells=1x1[0]>}]" in str(w)
    assert VOCABULARY.check(w) is w


BROKEN = [
    ("PFxo", 1, 1, "the vocabulary has no PFxo; did you mean 'PFox'"),
    ("PFox ·\n TMvoe<dist=1>(PFox)", 2, 2, "no TMvoe; did you mean 'TMove'"),
    ("TMove<dist=1>(ADog)", 1, 15, "the vocabulary has no ADog"),
    ("TMove(PFox)", 1, 1, "TMove needs a value for dist (real m)"),
    ("TMove<dits=1>(PFox)", 1, 1, "TMove has no dits (it has dist, angle); did you mean 'dist'"),
    ("TMove<dist=1s>(PFox)", 1, 1, "TMove: dist must be a number in m, not 1 s"),
    (
        'TMove<dist="1">(PFox)',
        1,
        1,
        "TMove: dist must be a number in m, not '1': write it without quotes",
    ),
    ("AFox#a<x=true>", 1, 1, "AFox#a: x must be a number in m, not True"),
    ("PFox<size=1>", 1, 1, "PFox has no size (it has none)"),
    ("AFox#a<plan={PFox · PDog}>", 1, 21, "the vocabulary has no PDog"),
    ("AFox#a<plans=[{},\n{PDog}]>", 2, 2, "the vocabulary has no PDog"),
    ("PMap<cells=1x1r[0.5]>", 1, 1, "cells must be a matrix of whole numbers"),
]


@pytest.mark.parametrize(("text", "line", "column", "said"), BROKEN, ids=[b[0] for b in BROKEN])
def test_a_string_that_breaks_it_is_refused_with_its_place(text, line, column, said):
    with pytest.raises(VocabularyError) as caught:
        VOCABULARY.read(text, "world.toml")
    assert said in caught.value.problem
    assert (caught.value.line, caught.value.column) == (line, column)
    assert str(caught.value).startswith(f"world.toml:{line}:{column}: ")
    assert str(caught.value).endswith("^")


def test_grammar_goes_first():
    with pytest.raises(GrammarError):
        VOCABULARY.read("PDog(")


AGENT = AgentNode("AFox", "a", ("x",), (1.0,))


@pytest.mark.parametrize(
    ("nodes", "said"),
    [
        ((AGENT, AGENT), "two agents have the id #a"),
        ((AGENT, replace(AGENT, id="b", scope=scene_of(AGENT))), "two agents have the id #a"),
        ((replace(AGENT, id="a b"),), "'a b' is not a valid agent id"),
        ((replace(AGENT, id=""),), "'' is not a valid agent id"),
        ((replace(AGENT, id="a\n"),), "is not a valid agent id"),
        ((replace(AGENT, values=()),), "one value for each name"),
        ((replace(AGENT, names=("x", "x"), values=(1.0, 2.0)),), "each name once"),
        ((replace(AGENT, values=(float("nan"),)),), "a finite number"),
        ((replace(AGENT, values=(None,)),), "needs a value for x"),
        ((FigureNode("TMove", ("dist",), (1.0,)),), "TMove is not a symbol of FigureNode"),
        ((TransformationNode("PFox"),), "PFox is not a symbol of TransformationNode"),
        ((AgentNode("PFox", "a"),), "PFox is not a symbol of AgentNode"),
        ((FigureNode(""),), "the vocabulary has no"),
        ((FigureNode("eHit"),), "the vocabulary has no eHit"),
    ],
)
def test_nodes_that_were_never_text_are_checked_too(nodes, said):
    """A fragment from the bus has no line and column; the error names the member."""
    with pytest.raises(VocabularyError, match=said) as caught:
        VOCABULARY.check(Scene(nodes), "member foxes")
    assert caught.value.line == 0
    assert str(caught.value).startswith("member foxes: ")


def test_a_string_nested_deeper_than_texts_go_is_refused_without_recursion():
    inner = scene_of(FigureNode("PFox"))
    for _ in range(5_000):
        inner = scene_of(AgentNode("AFox", "a", ("plan",), (inner,)))
    with pytest.raises(VocabularyError, match="at most 32 deep"):
        VOCABULARY.check(inner)


def test_a_matrix_in_w_is_read_only():
    matrix = np.zeros((2, 2), np.int16)
    w = VOCABULARY.check(scene_of(FigureNode("PMap", ("cells",), (matrix,))))
    before = w.digest
    matrix[0, 0] = 5
    assert Scene(w.nodes) == w
    assert scene_of(replace(w.nodes[0])).digest == before


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ((PFox, Primitive("PFox")), "PFox is declared twice"),
        ((Fox, eHit), "AFox responds to the unknown event type eDraw"),
        (
            (Fox, EventType("eHit", visual=True), eDraw),
            "AFox responds to eHit, which is visual: use @view",
        ),
        ((Fox, eHit, EventType("eDraw")), "AFox responds to eDraw, which is not visual: use @on"),
        ((Fox, eHit, eDraw, Fox), "AFox is declared twice"),
        (("PFox",), "'PFox' cannot be in a vocabulary"),
        ((Agent,), "cannot be in a vocabulary"),
        ((PFox(),), "cannot be in a vocabulary"),
    ],
)
def test_invalid_vocabularies(entries, said):
    with pytest.raises(MisuseError, match=said):
        Vocabulary.of(*entries)


def test_an_unknown_event_of_a_kind_gets_a_suggestion():
    kind = AgentKind("AX", Fox.kind.fields, frozenset({"eHti"}))
    with pytest.raises(MisuseError, match="did you mean 'eHit'"):
        Vocabulary.of(kind, eHit)


def test_its_contents():
    assert all(name in VOCABULARY for name in ("PMap", "TMove", "AFox", "eHit"))
    assert not any(name in VOCABULARY for name in ("PDog", "", "x", "Fox"))


def test_unchecked_and_checked_strings_are_equal_when_they_print_the_same():
    raw = parse("TMove<dist=1, angle=0>(PFox)")
    assert VOCABULARY.check(raw) == raw
    assert VOCABULARY.check(raw) is not raw
