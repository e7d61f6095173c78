"""Views in three dimensions show solids, and the agents that they belong to."""

import numpy as np
import pytest

from minerva_bodies import Ball, Box, euler
from minerva_bodies.pictures import SpacePictures
from minerva_bus import AgentKind, Metres, Primitive, Transformation, Vocabulary, WorldInfo, parse
from minerva_bus.grammar.fields import Fields
from minerva_services.geometry.picture import Copies, Lists

PBlock = Primitive("PBlock", Box(1, 1, "z", "#ff0000"), z=Metres)
PBall = Primitive("PBall", Ball(0.5, "#0000ff"))
TAt = Transformation("TAt", euler("x", "y", "z"), x=Metres, y=Metres, z=Metres)
WORDS = Vocabulary.of(PBlock, PBall, TAt, AgentKind("AStone", Fields.of({})))
SHOWN = Lists(WORDS, SpacePictures(WorldInfo("w", WORDS, 0, 0.1))).picture(
    PBlock(0.5) + parse("AStone#a"), {"a": TAt(3.0, 0.0, 2.0)(PBall())}
)


def test_opengl_draws_solids_in_light_and_picks_their_agents():
    pytest.importorskip("moderngl")
    from minerva_services.views.opengl.painter import GLPainter
    from minerva_services.views.window.painter import Sight
    from minerva_services.views.window.picking import pick, spot_of

    painter = GLPainter(azimuth=-90.0, elevation=60.0, zoom=1.0)
    painter.offscreen((400, 300))
    try:
        painter.draw(Sight(SHOWN))
        pixels = painter.pixels().astype(int)

        def at(*place):
            x, y, _ = painter.project(*np.array(place, float).reshape(3, 1))
            return float(x[0]), float(y[0])

        def color(*place):
            x, y = at(*place)
            return pixels[round(y), round(x)]

        assert pick(SHOWN, painter.project, (), at(3, 0, 2)).agent == "a"
        assert pick(SHOWN, painter.project, (), at(0, 0, 0.5)) is None
        spot = spot_of(SHOWN, "a")
        assert (spot.x, spot.y, spot.radius) == (3.0, 0.0, 0.5)
        red, _, blue = color(3, -0.3, 2.3)
        assert blue > 2 * red
        top, side = color(0, 0, 0.5), color(0, -1, 0)
        assert top[0] > 1.1 * side[0] > 3 * side[2]
    finally:
        painter.close()


def test_the_page_shows_solids_and_selects_their_agents():
    pytest.importorskip("viser")
    from minerva_services.views.solids import disc_table
    from minerva_services.views.web.picking import Clicked, clicked

    eye = np.array([3.0, -8.0, 9.0])
    for place, hit in (((3, 0, 2), Clicked("a", "a")), ((0, 0, 0), None)):
        ray = np.array(place) - eye
        assert clicked(eye, ray, disc_table([]), SHOWN.of(Copies), [], 1.0) == hit


def test_rerun_and_foxglove_have_the_meshes():
    pytest.importorskip("rerun")
    pytest.importorskip("foxglove")
    from foxglove.messages import Timestamp

    from minerva_services.views.foxglove.scene import scene_entities
    from minerva_services.views.rerun.rrd_file import solid_archetypes

    shown = solid_archetypes(SHOWN.of(Copies))
    assert sorted(shown) == ["world/solids/0/ff0000", "world/solids/1/0000ff"]
    entities = scene_entities(SHOWN, Timestamp(0, 0))
    assert "triangles=[TriangleListPrimitive" in repr(entities["a"])


def test_a_picture_has_a_polygon_for_each_face_that_is_seen():
    from minerva_bodies.drawing import SolidPictures

    shown = SolidPictures("world", WORDS, 400).draw(PBlock(0.5) + PBall(), 0)
    assert [shown.count(shape) for shape in ("<polygon", "<circle")] == [3, 3 + 2]  # with legend
