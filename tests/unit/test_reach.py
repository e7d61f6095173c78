"""Where the condition of an event can hold: never fewer regions than those with receivers."""

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from minerva_bus.grammar.condition import holds
from minerva_bus.grammar.scene import AgentNode
from minerva_bus.regions.partition import ByPosition
from minerva_bus.regions.reach import Reach
from minerva_bus.regions.tree import ByTree, Split

GRID = ByPosition((0.0, 1.0), (0.5,))
TREE = ByTree(Split("x", 0.0, Split("y", 0.5), Split("x", 1.0, above=Split("y", 0.0))))
ROW = ByPosition((0.0, 1.0, 2.0))
SQUARES = ByPosition((0.0, 1.0), (0.0, 1.0))
OBLONGS = ByPosition((0.0, 1.0, 2.0), (0.0, 0.5))

EDGES = [0.0, -0.0, 0.5, 1.0, 2.0, 5e-324, 2**53 + 1, float("inf"), float("nan"), True, "a", None]
values = st.one_of(st.sampled_from(EDGES), st.floats(-1, 3), st.integers(-1, 3))
comparisons = st.one_of(
    st.builds(
        "{} {} {}".format,
        st.sampled_from(["x", "y", "z"]),
        st.sampled_from(["<", "<=", ">", ">=", "==", "!="]),
        st.sampled_from(["0", "0.5", "1", "2", "-3", "9007199254740993", "true", '"a"', "y"]),
    ),
    st.sampled_from(["0.5 < x", "1 >= y", "x == x"]),
    st.builds(
        "distance({}) {} {}".format,
        st.sampled_from(
            [
                "x, y, 0, 0.5",
                "1.5, 0, x, y",
                "x, 0.5, y, 0",
                "y, 0, x, 0",
                "x, y, x, 9",
                "z, 0, 0, y",
                "x, y, 1e999, 0",
            ]
        ),
        st.sampled_from(["<", "<=", ">", ">=", "==", "!="]),
        st.sampled_from(["0", "0.5", "1", "1.8", "1e200", "z"]),
    ),
)
conditions = st.recursive(
    comparisons,
    lambda inner: st.one_of(
        st.builds("not ({})".format, inner),
        st.builds("({}) and ({})".format, inner, inner),
        st.builds("({}) or ({})".format, inner, inner),
    ),
    max_leaves=6,
)


@given(conditions, values, values, values)
@settings(max_examples=200, deadline=None)
def test_the_region_of_each_receiver_is_reached(condition, x, y, z):
    state = {name: value for name, value in (("x", x), ("y", y), ("z", z)) if value is not None}
    if not holds(condition, state):
        return
    agent = AgentNode("ARabbit", "r", tuple(state), tuple(state.values()))
    for partition in (GRID, TREE, ROW, SQUARES, OBLONGS):
        assert partition.region_of(agent) in Reach(partition).regions_for(condition)


@pytest.mark.parametrize(
    ("partition", "condition", "regions"),
    [
        (ROW, "x > 0.2 and x < 0.8", [1]),
        (ROW, "not (x <= 1.5)", [2, 3]),
        (ROW, "x < 0 or x > 2", [0, 3]),
        (ROW, "x == 1.5", [2]),
        (ROW, "x == 1", [2]),
        (ROW, "y > 3", [0, 1, 2, 3]),
        (ROW, "distance(x, y, 1.5, 0) < 0.6", [1, 2, 3]),
        (ROW, "0.4 >= distance(x, y, 1.5, 0)", [2]),
        (ROW, "distance(1, 0, 1.5, y) < 9", [0, 1, 2, 3]),
        (GRID, "distance(x, y, 0.9, 0.6) < 0.5", [1, 2, 4, 5]),
        (GRID, "distance(x, y, 2, 2) < 1.5", [4, 5]),
        (GRID, "distance(x, y, 2, 2) < 1.7", [4, 5, 2]),
        (GRID, "distance(x, y, -3, 2) < z", range(6)),
        (ROW, "distance(x, y, 0.5, 0) <= 0.5", [0, 1, 2]),
        (SQUARES, "not (distance(x, y, 0, 0) < 1.2)", range(9)),
        (SQUARES, "not (distance(x, y, 0, 0) >= 0)", [0, 1, 2, 3, 5, 6, 7, 8]),
        (
            SQUARES,
            "not (distance(x, y, 0, 0) < 1.5)",
            [0, 1, 2, 3, 5, 6, 7, 8],
        ),
        (
            SQUARES,
            "distance(x, y, 0.5, 0.5) > 0.8",
            [0, 1, 2, 3, 5, 6, 7, 8],
        ),
        (SQUARES, "distance(x, y, 0, 0) > 1.4142135623730951", [0, 1, 2, 3, 5, 6, 7, 8]),
        (SQUARES, "not (distance(x, y, 0, 0) == 9)", range(9)),
        (OBLONGS, "distance(y, 0, x, 0) > 1.8", [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]),
        (ROW, "x == true", [0, 1, 2, 3]),
        (ROW, "", [0, 1, 2, 3]),
        (GRID, "x > 0.2 and x < 0.8", range(6)),
        (GRID, "x > 0.2 and x < 0.8 and y < 0.1", [1]),
        (TREE, "x > 1.5 and y > -9 and y < -1", [3]),
    ],
)
def test_a_condition_excludes_regions(partition, condition, regions):
    assert [*Reach(partition).regions_for(condition)] == sorted(regions)


def test_cells_are_those_of_the_agents():
    for partition in (GRID, TREE, ROW):
        assert len(partition.cells) == partition.count
        for number, cell in enumerate(partition.cells):
            inside = {name: max(low, -5.0) for name, (low, _) in cell.items()}
            agent = AgentNode("ARabbit", "r", tuple(inside), tuple(inside.values()))
            assert partition.region_of(agent) == number
