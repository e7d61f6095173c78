"""Partitions by a function of the user: what it receives, and the errors that name it."""

import pytest

from minerva_bus.errors import MisuseError, UserCodeError
from minerva_bus.regions.partition import ByFunction
from minerva_bus.testing.family import Walker


def walker(name):
    return Walker(name).string.nodes[0]


def by_parity(name, state):
    return len(name) % 2


def test_the_function_receives_the_id_and_the_attributes():
    received = []

    def first(name, state):
        received.append((name, state))
        return 0

    node = walker("a")
    assert ByFunction(2, first).region_of(node) == 0
    assert received == [("a", node.state)]
    assert [ByFunction(2, by_parity).region_of(walker(name)) for name in ("a", "bb")] == [1, 0]


@pytest.mark.parametrize("region", [-1, 2, True, 1.0, None, "1"])
def test_what_is_no_region_is_an_error_that_names_the_function_and_the_agent(region):
    def west(name, state):
        return region

    with pytest.raises(MisuseError, match=r"regions: west returned .* for #a; expected .* 0 to 1"):
        ByFunction(2, west).region_of(walker("a"))


def test_an_error_in_the_function_names_it():
    def west(name, state):
        return state["nothing"]

    with pytest.raises(UserCodeError, match=r"^west: KeyError: 'nothing'$"):
        ByFunction(2, west).region_of(walker("a"))
