"""Columns: coded texts are their texts, and only columns of one shape have a delta."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import Agent, Vocabulary
from minerva_bus.grammar.columns import (
    Change,
    Coded,
    Column,
    Columns,
    Delta,
    difference,
    fits,
    packed,
    patched,
)
from minerva_bus.grammar.ids import Ids, RowDelta
from minerva_bus.grammar.scene import Scene
from minerva_bus.grammar.text_and_digest import scene_digest
from minerva_bus.grammar.types import Unfit, parse_type


class Fox(Agent, symbol="AFox"):
    energy: float = 0.0


class Hare(Agent, symbol="AHare"):
    energy: float = 0.0


VOCABULARY = Vocabulary.of(Fox, Hare)


def piece(kind, energy, count=100):
    text = " · ".join(f"{kind}#a{number}<energy={energy}>" for number in range(count))
    (columns,) = packed(VOCABULARY.read(text)).pieces
    assert isinstance(columns, Columns)
    return columns


@pytest.mark.parametrize("turned", [False, True])
def test_other_shapes_have_none(turned):
    foxes, hares = piece("AFox", 1), piece("AHare", 1)
    (node,) = VOCABULARY.read("AFox#a0<energy=1>").pieces
    for pair in ((foxes, hares), (foxes, node)):
        old, new = reversed(pair) if turned else pair
        assert difference(old, new) is None


def test_columns_of_one_shape_have_one():
    old, new = piece("AFox", 1), piece("AFox", 2)
    patch = difference(old, new)
    assert patch is not None
    assert patched(old, patch) == new
    unchanged = difference(old, old)
    assert (unchanged.changes, unchanged.empty) == ((), True)


def test_a_foreign_patch_may_change_a_column_several_times():
    """One of this project has one change of each column."""
    old = piece("AFox", 1, 70)
    turnover = RowDelta(70, np.array([0]), np.array([69]))
    (node,) = VOCABULARY.read("AFox#a0<energy=1>").pieces

    def foreign(*changes, turnover=None, born=None):
        parts = [
            Change(0, 0, rows and np.array(rows), Column(np.array(values, float)))
            for rows, values in changes
        ]
        return Delta(70, ("AFox",), tuple(parts), turnover, born)

    def energies(*changes, **rest):
        return patched(old, foreign(*changes, **rest)).columns[0].list()

    with_newborn = {"turnover": turnover, "born": Ids.of(("new",))}
    assert energies(([1], [5]), ([2], [6]), ([1], [7])) == [1, 7, 6, *[1] * 67]
    first, second, third = ([69, 0], [5, 6]), ([1], [7]), ([2, 0], [8, 9])
    assert energies(first, second, third, **with_newborn) == [9, 7, 8, *[1] * 66, 5]
    assert energies((None, range(70)), second, **with_newborn) == [0, 7, *range(2, 70)]
    with pytest.raises(Unfit, match="without values for 1 added AFox"):
        energies(([1, 2], [5, 6]), **with_newborn)
    with pytest.raises(Unfit, match="a patch of AFox, which is not in columns"):
        patched(node, foreign())


TEXTS = st.one_of(
    st.lists(st.sampled_from(["", "a", "b", "ill", "ä", "a b"]), min_size=1, max_size=9),
    st.lists(st.sampled_from(["a", "ä"]), min_size=8, max_size=12),
)
WORDS = parse_type("text a|b|ill")


def plain(texts):
    array = np.empty(len(texts), object)
    array[:] = texts
    return Column(array)


def coded(texts):
    return Column.of_coded(Coded.of(plain(texts).array))


def alike(left, right):
    """Whether two columns are one in every respect that others see."""
    assert left.list() == right.list()
    assert (len(left), left.dtype) == (len(right), right.dtype)
    for kind in (parse_type("text"), WORDS, parse_type("int")):
        assert fits(kind, left) == fits(kind, right)
    digests = {scene_digest(_scene(each)) for each in (left, right)}
    assert len(digests) == 1


def _scene(column):
    ids = Ids.numbered("a", range(len(column)))
    return Scene((Columns("AKind", ("s",), (column,), len(column), ids),))


@given(TEXTS, st.data())
def test_a_coded_column_is_that_of_its_texts(texts, data):
    alike(coded(texts), plain(texts))
    rows = np.array(data.draw(st.lists(st.integers(0, len(texts) - 1))), np.intp)
    alike(coded(texts).take(rows), plain(texts).take(rows))
    alike(coded(texts).take(slice(1, None)), plain(texts).take(slice(1, None)))
    some = np.unique(rows)
    others = data.draw(
        st.lists(st.sampled_from(["a", "c"]), min_size=len(some), max_size=len(some))
    )
    for new in (plain(others), coded(others)):
        alike(coded(texts).moved(rows, some[some < len(rows)], new.take(some < len(rows))),
              plain(texts).moved(rows, some[some < len(rows)], new.take(some < len(rows))))  # fmt: skip
        alike(coded(texts).put(some, new.array), plain(texts).put(some, new.array))
        alike(Column.concatenated([coded(texts), new]), plain([*texts, *others]))


@given(TEXTS, st.data())
def test_differences_of_coded_columns_are_those_of_texts(texts, data):
    other = texts.copy()
    for row in data.draw(st.sets(st.integers(0, len(texts) - 1))):
        other[row] = data.draw(st.sampled_from([*texts, "new"]))
    rows = np.flatnonzero(np.array(texts) != np.array(other))
    for left in (plain, coded):
        for right in (plain, coded):
            different = left(texts).differs(right(other))
            if different is None:
                different = np.arange(len(texts))
            assert np.array_equal(different, rows)
    old = coded(texts)
    scene_digest(_scene(old))  # which keeps digests of chunks
    alike(old.changed(rows, coded(other)), plain(other))


def test_words_without_a_row_do_not_count():
    left = coded(["ä", *["a"] * 20]).take(slice(1, None))
    alike(left, plain(["a"] * 20))
    assert left.words is not None
    assert left.words.tolist() == ["a"]
