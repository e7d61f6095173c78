"""η on whole strings: columns of other kinds, events of columns, and the limit of copies."""

import numpy as np
import pytest
from pond import VOCABULARY, Minnow

from minerva_bus import EMPTY, Frame, evolve
from minerva_bus.errors import MisuseError
from minerva_bus.world import evolution
from minerva_bus.world.evolution import Policy


def test_a_string_without_columns_sends_no_batches():
    assert evolve(EMPTY, [], []).batches == ()


def test_columns_of_other_kinds_do_not_change():
    minnows = Minnow.many("m", 70, x=np.arange(70.0))
    assert evolve(minnows, [], []).scene == minnows


def test_copies_of_agents_side_by_side_add_up():
    two = VOCABULARY.read("ACounter#a · ACounter#b")
    half = evolution.MOST_COPIES // 2
    evolution._check_few(two, half, Frame(), Policy.LITERAL)
    with pytest.raises(MisuseError, match="literal"):
        evolution._check_few(two, half + 1, Frame(), Policy.LITERAL)
