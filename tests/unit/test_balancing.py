"""Borders between regions that follow the agents."""

import pytest

from minerva_bus.errors import ProtocolError
from minerva_bus.grammar.packing import packed
from minerva_bus.grammar.scene import AgentNode, Scene
from minerva_bus.regions.balancing import balanced, borders_of, is_due, moved
from minerva_bus.regions.partition import ById, ByPosition
from minerva_bus.regions.tree import ByTree, Split


def crowd(*points, columns=False):
    nodes = tuple(
        AgentNode("ARabbit", f"r{n}", ("x", "y"), point) for n, point in enumerate(points)
    )
    return packed(Scene(nodes)) if columns else Scene(nodes)


def loads(partition, scene):
    made = [0] * partition.count
    for node in scene.nodes:
        made[partition.region_of(node)] += 1
    return made


TREE = Split("x", 0.0, Split("y", 0.0, Split("x", -1.0)), Split("y", 0.0, above=Split("x", 1.0)))


@pytest.mark.parametrize("columns", [False, True])
@pytest.mark.parametrize(
    "partition", [ByPosition((1.0, 2.0, 3.0)), ByPosition((0.0,), (0.0,)), ByTree(TREE)]
)
def test_regions_have_equally_many_agents_afterwards(partition, columns):
    scene = crowd(*((float(n), float(n * 7 % 60)) for n in range(60)), columns=columns)
    after = partition.moved(balanced(partition, scene))
    assert after.count == partition.count
    spread = max(loads(after, scene)) - min(loads(after, scene))
    # Columns and rows of a grid are balanced, not each of its cells.
    assert spread <= (4 if len(after.attributes) > 1 else 1)
    assert spread < max(loads(partition, scene)) - min(loads(partition, scene))


def test_borders_stay_if_there_is_no_agent_with_a_place():
    partition = ByPosition((1.0,), (2.0,))
    nowhere = crowd((float("nan"), 1.0), (1.0, float("inf")))
    for scene in (Scene(()), nowhere, Scene((AgentNode("ARabbit", "r", ("x",), (1.0,)),))):
        assert balanced(partition, scene) == (1.0, 2.0)
    # All agents of a tree may be on one side of a split.
    tree = ByTree(TREE)
    assert len(balanced(tree, crowd((5.0, 5.0)))) == len(tree.borders)


def test_borders_travel_as_bytes():
    for partition in (ByPosition((1.0,), (2.0, 3.0)), ByTree(TREE)):
        borders = tuple(border + 0.1 for border in partition.borders)
        after = partition.moved(borders)
        assert after.borders == borders
        assert moved(partition, borders_of(after)) == after
        number = len(borders)
        with pytest.raises(ProtocolError, match=f"borders: 1 borders; expected {number}"):
            moved(partition, bytes(8))
    assert moved(ById(2), b"") == ById(2)
    with pytest.raises(ProtocolError, match="no borders"):
        moved(ById(2), bytes(8))


def test_borders_move_after_a_number_of_frames():
    assert [n for n in range(10) if is_due(ByPosition((1.0,), balance=4), n)] == [4, 8]
    assert not any(is_due(partition, 4) for partition in (ByPosition((1.0,)), ById(2), None))
