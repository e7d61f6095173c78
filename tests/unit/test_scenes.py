"""Strings and nodes as values."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

from minerva_bus import EMPTY, Scene, parse
from minerva_bus.grammar.digest import scene_digest
from minerva_bus.grammar.scene import FigureNode, TransformationNode, agents, scene_of, with_scope
from minerva_bus.grammar.traversal import identities, rebuild, walk


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
