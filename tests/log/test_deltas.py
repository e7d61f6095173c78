"""A delta converts one string exactly into the other; invalid deltas are rejected."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minerva_bus import Agent, Metres, Primitive, Transformation, Vocabulary
from minerva_bus.errors import ProtocolError, SceneError
from minerva_bus.grammar.columns import packed
from minerva_bus.grammar.scene import Scene, with_scope
from minerva_bus.log.entries import DEEPEST, apply_delta, delta_between
from minerva_bus.testing.strategies import strings_of as any_strings
from minerva_bus.testing.strategies import worlds
from minerva_bus.wire.plain import pack, unpack
from minerva_bus.wire.strings_codec import Reader, plain_scene
from tests.family import FAMILY_VOCABULARY, family_strings
from tests.log.recorded_runs import happened, strings_of

PStar = Primitive("PStar", size=Metres)
TMove = Transformation("TMove", dist=Metres)
SKY = Vocabulary.of(PStar, TMove)


def sent(plain):
    return unpack(pack(plain))


def decoded(scene, vocabulary):
    """The string after decoding: different objects, equal pieces."""
    return Reader(vocabulary).scene(sent(plain_scene(scene)))


def check(old, new, vocabulary):
    delta = sent(delta_between(old, new))
    made = apply_delta(decoded(old, vocabulary), delta, Reader(vocabulary))
    assert made == new
    assert list(map(type, made.pieces)) == list(map(type, new.pieces))
    return delta


@settings(max_examples=20)
@given(
    worlds().flatmap(lambda world: st.tuples(st.just(world), any_strings(world[0]), st.randoms()))
)
def test_any_string_is_made_of_any_other(given):
    (vocabulary, old), other, chance = given
    pieces = [*old.pieces, *other.pieces]
    chance.shuffle(pieces)
    known = {piece.id for piece in pieces if hasattr(piece, "id")}
    inner = any(list(piece.scope) for piece in pieces if hasattr(piece, "scope"))
    if inner or len(known) < sum(hasattr(piece, "id") for piece in pieces):
        check(old, other, vocabulary)  # a mixture could have duplicate ids
    else:
        check(old, Scene(tuple(pieces)), vocabulary)


class Bare(Agent, symbol="ABare"):
    """An agent without attributes."""


def test_another_agent_of_the_same_kind_is_another():
    vocabulary = Vocabulary.of(PStar, Bare)
    old = vocabulary.read("ABare#a() · PStar<size=1> · ABare#b(PStar<size=2>)")
    new = vocabulary.read("ABare#c() · PStar<size=1> · ABare#d(PStar<size=2>)")
    check(old, new, vocabulary)


@given(family_strings(), family_strings())
def test_also_of_agents(old, new):
    check(old, new, FAMILY_VOCABULARY)
    assert delta_between(old, old) == []


@given(st.lists(st.sampled_from("abcde")), st.lists(st.sampled_from("abcde")))
def test_the_same_piece_may_stand_in_many_places(old, new):
    stars = {name: PStar(float(place)).pieces[0] for place, name in enumerate("abcde")}
    check(Scene(tuple(stars[name] for name in old)), Scene(tuple(stars[name] for name in new)), SKY)


@pytest.mark.parametrize("name", ["meadow", "flock", "robot"])
def test_a_whole_run(name):
    vocabulary = happened(name)[0].world.vocabulary
    strings = strings_of(name)
    reader, made = Reader(vocabulary), decoded(packed(strings[0]), vocabulary)
    for old, new in zip([packed(strings[0]), *strings[1:]], strings[1:], strict=False):
        made = apply_delta(made, sent(delta_between(old, new)), reader)
        assert made.digest == new.digest


def test_unchanged_parts_cost_nothing():
    old = SKY.read(" · ".join(f"TMove<dist={n}>(PStar<size=1>)" for n in range(20)))
    new = Scene((*old.pieces[:7], *PStar(2.0).pieces, *old.pieces[8:]))
    assert check(old, new, SKY) == [7, -1, [1, ["PStar", [2.0]]]]
    assert check(old, Scene(old.pieces[3:]), SKY) != []


def test_a_scope_is_edited_in_its_place():
    old = SKY.read("TMove<dist=1>(PStar<size=1> · PStar<size=2>) · PStar<size=3>")
    node = old.nodes[0]
    scope = Scene((node.scope.pieces[0], *PStar(9.0).pieces))
    new = Scene((type(node)(node.symbol, node.names, node.values, scope), old.nodes[1]))
    assert check(old, new, SKY) == [{"scope": [1, -1, [1, ["PStar", [9.0]]]]}]


def test_scopes_deeper_than_any_stack():
    def deep(size):
        scene = PStar(size)
        for _ in range(5000):
            scene = TMove(1.0)(scene)
        return scene

    old = deep(1.0)
    check(old, deep(2.0), SKY)


@pytest.mark.parametrize(
    "delta",
    [
        None,
        3,
        [5],
        [-5],
        [0],
        ["PStar"],
        [[1, ["PStar", ["big"]]]],
        [[2, ["PStar", [1.0]]]],
        [["patch", 3, ["PStar"], []]],
        [["patch"]],
        [{"scope": [9]}],
        [{"scope": [], "more": 1}],
        [1, {"scope": []}],
        [None],
        [1.5],
        [True],
    ],
)
def test_an_invalid_edit_is_rejected(delta):
    old = SKY.read("TMove<dist=1>(PStar<size=1>) · PStar<size=2>")
    with pytest.raises((ProtocolError, SceneError)):
        apply_delta(old, delta, Reader(SKY))


@pytest.mark.parametrize("below", [0, 1])
def test_an_edit_goes_as_deep_as_allowed_and_no_deeper(below):
    """A scope below that is written as a whole; a delta that enters it is refused."""
    (around,) = TMove(1.0)(PStar(0.0)).pieces

    def deep(scene, scopes):
        for _ in range(scopes):
            scene = Scene((with_scope(around, scene),))
        return scene

    old, new = (deep(PStar(size), DEEPEST + below) for size in (1.0, 2.0))
    edit = wanted = [-1, plain_scene(deep(PStar(2.0), below))]
    for _ in range(DEEPEST):
        wanted = [{"scope": wanted}]
    assert delta_between(old, new) == wanted
    assert apply_delta(old, wanted, Reader(SKY)) == new
    for _ in range(DEEPEST + 1):
        edit = [{"scope": edit}]
    with pytest.raises(ProtocolError, match="scopes deep"):
        apply_delta(deep(old, 1), edit, Reader(SKY))
