"""Tables of places do what lists of tuples do, whatever their lengths."""

from itertools import pairwise

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from minerva_bus.frame.composition import Composition
from minerva_bus.grammar.scene import EMPTY
from minerva_bus.regions.place_table import (
    PlaceTable,
    joined,
    numbers_in,
    order_of,
    repeats,
    taken,
)
from minerva_bus.regions.places import after_frame, packed_places, spans, unpacked_places
from minerva_bus.testing.family import Walker

numbers = st.integers(-(1 << 63), (1 << 63) - 1) | st.integers(-2, 2)


def lists_of(length):
    return st.lists(st.tuples(*[numbers] * length), max_size=9)


def in_tables(places):
    """As they arrive from another process."""
    return unpacked_places(packed_places(places), len(places), "places")


parts = st.lists(st.sampled_from([1, 3, 5]).flatmap(lists_of), max_size=4)


@given(parts)
def test_tables_are_joined_and_sorted_as_lists_are(parts):
    every = [place for part in parts for place in part]
    places = joined(map(in_tables, parts))
    assert [*places] == every
    assert numbers_in(places) == sum(map(len, every))
    assert repeats(places) == any(a == b for a, b in pairwise(every))
    order = order_of(places)
    assert order.tolist() == sorted(range(len(every)), key=every.__getitem__)
    assert [*taken(places, order)] == sorted(every)
    assert [*in_tables(places)] == every


@given(lists_of(3).filter(bool))
def test_a_table_is_a_sequence(places):
    table = in_tables(places)
    assert isinstance(table, PlaceTable)
    assert table == places
    assert table == in_tables(places)
    assert table != [*places, places[0]]
    assert table[1:] == places[1:]
    assert [table[row] for row in range(len(places))] == places
    assert {type(number) for place in table for number in place} == {int}


def test_tables_of_other_lengths_differ():
    assert PlaceTable.numbered(2) == [(0,), (1,)]
    assert PlaceTable.numbered(2) != PlaceTable(np.zeros((2, 3), np.int64))
    assert PlaceTable.numbered(2) != "ab"
    with pytest.raises(TypeError):
        hash(PlaceTable.numbered(1))


def test_agents_in_columns_that_all_die_leave_no_places():
    composition = Composition(Walker.many("w", 20))
    ((_, name, _, _),) = spans(composition)
    places = [(row,) for row in range(20)]
    assert list(after_frame(places, composition, {name: EMPTY}, 3)) == []
    assert list(after_frame(places, composition, {}, 3)) == places
