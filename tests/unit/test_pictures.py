"""The list of drawable items that all form-driven geometric systems share."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minerva_bus import Disc, Label, Line, Metres, Motion, Primitive, Raster, Transformation
from minerva_bus.grammar.columns import packed
from minerva_bus.grammar.scene import EMPTY, AgentNode, Scene
from minerva_bus.grammar.types import Cells, Degrees
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Discs, Lists, Polyline, Texts, Tiles

PDot = Primitive("PDot", Disc("r", "#ff8000", heading=True, height=0.5), name=str, r=Metres)
PWay = Primitive("PWay", Line("xs", "ys"), xs=tuple[float, ...], ys=tuple[float, ...])
PFloor = Primitive("PFloor", Raster("cells", 0.5, x=1.0), cells=Cells)
PName = Primitive("PName", Label("text"), text=str)
PVoid = Primitive("PVoid", size=float)
TPut = Transformation(
    "TPut", Motion("x", "y", "turn", "go"), x=float, y=float, turn=Degrees, go=float
)
TDye = Transformation("TDye", hue=float)
WORDS = Vocabulary.of(PDot, PWay, PFloor, PName, PVoid, TPut, TDye)


def listed(scene, **parts):
    return Lists(WORDS).picture(scene, parts).items


def test_a_disc_stands_where_the_transformations_have_led_to():
    (discs,) = listed(TPut(1.0, 2.0, 90.0, 3.0)(TPut(1.0, 0.0, 45.0, 0.0)(PDot("d", 0.2))))
    assert (discs.x[0], discs.y[0], discs.angle[0]) == pytest.approx((1.0, 6.0, 135.0))
    assert (discs.radius[0], discs.height[0], discs.names[0]) == (0.2, 0.5, "d")
    assert discs.color.tolist() == [[255, 128, 0]]
    assert discs.heading.tolist() == [True]


def test_every_form_is_listed_in_the_strings_order():
    cells = np.zeros((2, 3), np.int16)
    scene = (
        PFloor(cells) + PDot("a", 1.0) + PDot("b", 2.0) + PWay((0.0, 1.0), (0.0, 2.0)) + PVoid(1.0)
    )
    floor, discs, way, name = listed(scene + TPut(5.0, 0.0, 90.0, 0.0)(PName("hall")))
    assert isinstance(floor, Tiles)
    assert (floor.size, floor.pose.x) == ((1.0, 1.5), 1.0)
    assert isinstance(discs, Discs)
    assert list(discs.names) == ["a", "b"]
    assert isinstance(way, Polyline)
    assert way.points.tolist() == [[0.0, 0.0], [1.0, 2.0]]
    assert isinstance(name, Texts)
    assert (list(name.texts), name.x[0]) == (["hall"], 5.0)


def test_parts_are_in_the_slots_of_their_agents():
    skeleton = (
        PDot("s", 1.0)
        + Scene((AgentNode("ADog", "rex"),))
        + TPut(9.0, 0.0, 0.0, 0.0)(Scene((AgentNode("ADog", "bel"),)))
    )
    (discs,) = listed(skeleton, rex=PDot("r", 1.0), bel=PDot("b", 1.0))
    assert list(discs.owners) == ["", "rex", "bel"]
    assert discs.x.tolist() == [0.0, 0.0, 9.0]
    assert [discs.agent(row) for row in range(3)] == ["", "rex", "bel"]


def test_in_a_population_a_figure_names_its_agent():
    birds = packed(Scene(tuple(n for i in range(40) for n in PDot(f"b{i}", 1.0).nodes)))
    (discs,) = listed(Scene((AgentNode("ABird", "~ABird.1"),)), **{"~ABird.1": birds})
    assert [discs.agent(row) for row in (0, 39)] == ["b0", "b39"]


def test_unchanged_parts_are_not_listed_again():
    lists, cells = Lists(WORDS), np.zeros((2, 2), np.int16)
    skeleton = PFloor(cells) + Scene((AgentNode("ADog", "rex"),))
    still, moving = PWay((0.0,), (0.0,)), PWay((1.0,), (1.0,))
    floor, way = lists.picture(skeleton, {"rex": still}).items
    assert lists.picture(skeleton, {"rex": still}).items == (floor, way)
    again, other = lists.picture(skeleton, {"rex": moving}).items
    assert again is floor
    assert other is not way
    assert lists.picture(skeleton, {"rex": EMPTY}).items == (floor,)
    assert lists.picture(skeleton, {}).items == (floor,)


numbers = st.floats(-1e3, 1e3)


@given(st.lists(st.tuples(numbers, numbers, numbers, numbers, numbers), min_size=32, max_size=40))
def test_many_at_once_are_as_one_by_one(rows):
    nodes = [
        TPut(x, y, a, go)(TDye(1.0)(TPut(go, 0.0, x, 0.0)(PDot("n", abs(r))))).nodes[0]
        for x, y, a, go, r in rows
    ]
    scene = TPut(1.0, 2.0, 30.0, 0.5)(Scene(tuple(nodes)))
    together = TPut(1.0, 2.0, 30.0, 0.5)(packed(Scene(tuple(nodes))))
    (single,), (columns,) = listed(scene), listed(together)
    for name in ("x", "y", "angle", "radius", "height", "color", "heading"):
        assert np.allclose(getattr(single, name), getattr(columns, name), atol=1e-6)
    assert list(single.names) == list(columns.names)


def test_colours():
    assert rgb("#0a0b0c") == (10, 11, 12)
    assert rgb("#fff") == (255, 255, 255)
    assert rgb("none") == (0x88, 0x88, 0x88)
    assert math.isfinite(sum(rgb("")))
