"""Laws of the language L(M), Table 1, for arbitrary strings."""

from random import Random

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, example, given, settings

from minerva_bus.errors import SceneError
from minerva_bus.grammar.parser import parse
from minerva_bus.grammar.scene import EMPTY, FigureNode, Scene, agents, scene_of, walk
from minerva_bus.grammar.text_and_digest import head
from minerva_bus.testing.strategies import scenes, values, vocabularies, worlds

law = settings(suppress_health_check=list(HealthCheck))


@law
@given(scenes(depth=2))
def test_a_printed_string_parses_to_the_same_string(w):
    assert parse(str(w)) == w


@law
@given(scenes(depth=2))
def test_print_is_canonical(w):
    assert str(parse(str(w))) == str(w)


def spelled(w, chance):
    """A text of a string as in hand-written files: whitespace, comments and few dots."""
    text, before = "", None
    for opens, node in walk(w):
        if not opens:
            text, before = text + chance.choice([")", " ) "]), node
            continue
        if before is not None:
            bare = isinstance(before, FigureNode) and isinstance(node, FigureNode)
            text += chance.choice([" ", "\n", " // and\n"] if bare else [" · ", ".", "\n·"])
        text, before = text + head(node), node
        if not isinstance(node, FigureNode):
            text, before = text + "(", None
    return text


@settings(law, max_examples=40)
@given(scenes(depth=1), st.integers(0, 1 << 32))
def test_a_figure_may_be_spelled_without_dots(w, seed):
    """Rule 6, p⁺: dots between primitives are optional in a concatenation."""
    again = parse(spelled(w, Random(seed)))
    assert again == w
    assert str(again) == str(w)


@law
@given(values(depth=3))
@example(-0.0)
@example(1e308)
@example(5e-324)
@example(1e16)
@example(-(1 << 63))
@example('"\\ \n\u2028 \x7f é 漢 🦊')
@example(((), ((),)))
def test_every_value_reads_back(value):
    w = scene_of(FigureNode("PAny", ("value",), (value,)))
    assert parse(str(w)) == w
    assert str(parse(str(w))) == str(w)


@law
@given(scenes(depth=1), scenes(depth=1))
def test_equal_means_same_text_and_same_digest(w, v):
    assert (w == v) == (str(w) == str(v)) == (w.digest == v.digest)
    assert w != v or hash(w) == hash(v)


@law
@given(st.data())
def test_strings_that_differ_a_little_are_not_equal(data):
    """Random pairs are rarely close, so this changes a single value of a string."""
    first, other = data.draw(values(depth=1)), data.draw(values(depth=1))
    w = scene_of(FigureNode("PAny", ("value",), (first,)))
    v = scene_of(FigureNode("PAny", ("value",), (other,)))
    assert (w == v) == (str(w) == str(v)) == (w.digest == v.digest)


@law
@given(scenes(), scenes(), scenes())
def test_concatenation_is_a_monoid(u, v, w):
    assert (u + v) + w == u + (v + w)
    assert u + EMPTY == u == EMPTY + u


@law
@given(worlds())
def test_checked_strings_read_back_through_their_vocabulary(world):
    vocabulary, w = world
    again = vocabulary.read(str(w))
    assert again == w
    assert str(again) == str(w)


@law
@given(worlds())
def test_check_is_idempotent_and_shares_what_it_keeps(world):
    vocabulary, w = world
    assert vocabulary.check(w) is w
    read = vocabulary.check(parse(str(w)))
    assert vocabulary.check(read) is read
    assert read == w


@law
@given(worlds())
def test_check_gives_every_occurrence_the_names_of_its_symbol(world):
    vocabulary, w = world
    for agent in agents(vocabulary.read(str(w))):
        assert agent.names is vocabulary.kinds[agent.symbol].fields.names


@law
@given(vocabularies(), scenes())
def test_a_string_of_another_world_is_refused_or_checked(vocabulary, w):
    try:
        checked = vocabulary.check(w)
    except SceneError:
        return
    assert vocabulary.check(checked) is checked


CORPUS = (
    'TMove<dist=1.5m, at=[1, [2]]>(PFox<name="a\\n">) · AFox#a<w={PA · A}>() // end',
    "PMap<cells=2x3[0*4 1 0], heights=1x2r[0.5*2]>.PMap<on=true>",
    "A#x · A · AFox<a=-0.0, b=1e308, d=9223372036854775807>(T(T(PA)·PB))\n// c\n·PC<x=[{}]>",
    "PA<x=1 m/s, y=3°, z={PA<y={ε}>}>",
)
SIGNS = 'PTA#<>()[]{}=,"\\*x·./ 0159-eErεm\n\t\u2028\ud800é'


def mangled(text, chance):
    """The text with parts deleted, repeated, reversed or overwritten."""
    for _ in range(chance.randint(1, 4)):
        i, j = sorted((chance.randint(0, len(text)), chance.randint(0, len(text))))
        signs = "".join(chance.choices(SIGNS, k=chance.randint(1, 3)))
        text = chance.choice(
            (
                text[:i] + text[j:],
                text[:i] + text[i + 1 :],
                text[:j] + text[i:],
                text[:i] + signs + text[i:],
                text[:i] + text[i:j][::-1] + text[j:],
                text[:i] + signs + text[i + len(signs) :],
            )
        )
    return text


def mangled_often(text, seed):
    chance = Random(seed)
    return [mangled(text, chance) for _ in range(30)]


texts = st.sampled_from(CORPUS) | scenes(depth=1).map(str)


def parsed(text):
    try:
        return parse(text), None
    except SceneError as error:
        return EMPTY, error


@law
@given(st.builds(mangled_often, texts, st.integers(0, 1 << 32)))
def test_a_mangled_text_is_a_string_or_a_scene_error(mangled):
    for text in mangled:
        w, error = parsed(text)
        if error is None:
            assert parse(str(w)) == w
        else:
            assert error.line >= 1
            assert error.column >= 1
            assert error.expected


@law
@given(worlds(), st.integers(0, 1 << 32))
def test_a_mangled_text_never_gets_past_a_vocabulary_unchecked(world, seed):
    vocabulary, w = world
    for text in mangled_often(str(w), seed):
        try:
            read = vocabulary.read(text)
        except SceneError:
            continue
        assert vocabulary.check(read) is read


@pytest.mark.timeout(30)
@pytest.mark.parametrize(
    "text",
    [
        "PA<x=" * 100_000,
        "PA<x=[" + "[" * 100_000,
        "PA<x={PA<x=" * 100_000,
        "T(" * 100_000,
        ")" * 200_000,
        'PA<x="' + "\\" * 200_001,
        "// " * 200_000 + "\n)",
        "PA<x=1x1[" * 50_000,
        "PA<x={" + '"' * 100_001,
        "A#" * 100_000,
        "PA<" + "x=1," * 100_000,
        "PA<x={P}>·" * 50_000,
        "PA<x={A}>·" * 20_000,
        "PA<x=" + "1" * 1_000_000,
        "PA<x=" + "1e" * 100_000,
        "PA<x=99999x99999[0*9999800001]>",
        "PA<x=1" + " " * 200_000 + ";",
    ],
    ids=lambda text: text[:12],
)
def test_hostile_texts_fail_at_once(text):
    """Parsing has bounded recursion and no quadratic rescans of the text."""
    with pytest.raises(SceneError):
        parse(text)


def test_a_scene_is_never_two_strings():
    """ε prints as the empty text, and the empty text parses as ε."""
    assert parse("") == parse("ε") == parse(" // nothing\n") == EMPTY == Scene()
    assert str(EMPTY) == ""
