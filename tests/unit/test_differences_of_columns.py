"""Only columns of one shape have a delta."""

import pytest

from minerva_bus import Agent, Vocabulary
from minerva_bus.grammar.columns import Columns
from minerva_bus.grammar.delta import difference, patched
from minerva_bus.grammar.packing import packed


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
