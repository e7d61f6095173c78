"""The content and positions of drawings."""

import numpy as np
import pytest
from opengl_world import (
    BALL,
    PIN,
    PBall,
    PHeat,
    PWay,
    at,
    drawn,
    floor,
    like,
    needs_driver,
    picture,
)
from sprites_world import ROBOT, PMap, PRobot, PSign, TPut

from minerva_bus import EMPTY
from minerva_services.geometry.picture import Discs, Picture
from minerva_services.views.opengl.drums import instances
from minerva_services.views.opengl.ribbons import raised_lines, ribbon
from minerva_services.views.sprites.painter import SpritePainter
from minerva_services.views.window.painter import Beams, Sight
from minerva_services.views.window.picking import Hit, pick

pytestmark = needs_driver


@pytest.mark.parametrize("camera", [(-90.0, 60.0, 1.0), (30.0, 35.0, 1.5), (-90.0, 90.0, 1.0)])
def test_a_disc_is_where_the_camera_projects_its_lid(camera):
    painter, _ = drawn(floor(), camera=camera)
    for place in ((6.0, 4.0), (5.0, 5.5), (7.5, 3.0)):
        painter.draw(Sight(picture(floor() + TPut(*place)(PBall(0.4)))))
        pixels = like(painter.pixels(), BALL)
        assert len(pixels) > 60
        assert middle(pixels) == pytest.approx(at(painter, *place, 0.4), abs=3)


def test_sprites_show_the_same_disc_at_the_same_place():
    scene = floor() + TPut(7.3, 3.1)(PBall(0.4))
    painter, pixels = drawn(scene)
    flat = SpritePainter()
    flat.offscreen((900, 600))
    flat.draw(Sight(picture(scene)))
    corners = np.array([0.0, 12.0]), np.array([0.0, 8.0])
    (left, right), (bottom, top), _ = flat.project(*corners, np.zeros(2))
    across, down = middle(like(flat.pixels(), BALL))
    place = 12 * (across - left) / (right - left), 8 * (down - bottom) / (top - bottom)
    seen = painter.camera.ground(*middle(like(pixels, BALL)), 900, 600, z=0.4)
    assert seen == pytest.approx(place, abs=0.05)


def middle(points):
    return (points.min(axis=0) + points.max(axis=0) + 1) / 2


def test_the_heading_mark_is_before_the_middle():
    for angle in (0.0, 90.0, 200.0):
        scene = floor() + TPut(6.0, 4.0, angle)(PRobot("r1", 0.5))
        painter, pixels = drawn(scene, camera=(-90.0, 90.0, 4.0))
        robot, white = like(pixels, ROBOT), like(pixels, (255, 255, 255), 3)
        centre = at(painter, 6.0, 4.0, 0.3)
        near = white[np.hypot(*(white - centre).T) < np.ptp(robot[:, 0]) / 2]
        tip = near[np.argmax(np.hypot(*(near - centre).T))] - centre
        ahead = np.degrees(np.arctan2(-tip[1], tip[0]))
        assert abs((ahead - angle + 180) % 360 - 180) < 6


def test_walls_stand_up_and_hide_what_is_behind_them():
    (_, seen), (_, hidden) = (
        drawn(floor() + TPut(6.0, y)(PBall(0.1)), camera=(90.0, 20.0, 1.0)) for y in (4.0, 7.6)
    )
    assert len(like(seen, BALL, 25)) > 20
    assert not len(like(hidden, BALL, 25))


def test_areas_in_the_shadow_of_a_wall_are_darker():
    painter, pixels = drawn(floor())
    shade, light = (at(painter, x, 4.0, 0.0).astype(int) for x in (2.5, 6.0))
    assert pixels[light[1], light[0]].min() > 235
    assert pixels[shade[1], shade[0]].max() < 220


def test_transparent_colours_tint_floor_and_wall_tops():
    cells = np.zeros((24, 16), np.int16)
    cells[:12] = 1
    (painter, bare), (_, tinted) = (drawn(floor() + more) for more in (EMPTY, PHeat(cells)))
    for place, changes in (
        ((4.0, 4.0, 0.0), True),
        ((2.1, 4.0, 1.0), True),
        ((8.0, 4.0, 0), False),
    ):
        x, y = at(painter, *place).astype(int)
        difference = tinted[y, x].astype(int) - bare[y, x]
        assert (difference[0] - difference[2] > 15) == changes


def test_only_a_changed_matrix_is_drawn_again():
    painter, before = drawn(floor())
    known = painter._scene._floors._shown
    painter.draw(Sight(picture(floor())))
    assert painter._scene._floors._shown[0] is not known[0]
    same = picture(floor())
    kept = []
    for _ in range(2):
        painter.draw(Sight(Picture((*same.items,))))
        kept.append(painter._scene._floors._shown[0])
    assert kept[0] is kept[1]
    assert np.array_equal(before, painter.pixels())
    painter.draw(Sight(picture(PMap(np.full((60, 40), 100, np.int16), 0.2))))
    assert (before != painter.pixels()).any(axis=2).mean() > 0.2


def test_signs_are_at_their_pins_and_can_be_clicked():
    scene = floor() + TPut(3.0, 2.0)(PSign("attic")) + TPut(8.0, 5.0)(PSign("cellar"))
    painter, pixels = drawn(scene)
    balls = like(pixels, PIN, 90)
    for words, place in (("attic", (3.0, 2.0)), ("cellar", (8.0, 5.0))):
        ball = at(painter, *place, painter._scene.pins.sizes.height)
        assert np.hypot(*(balls - ball).T).min() < 4
        box = next(label for label in reversed(painter.labels()) if label.text == words)
        plate = (box.left + box.right) / 2, (box.top + box.bottom) / 2
        assert pick(picture(scene), painter.project, painter.labels(), plate) == Hit(label=words)
        assert pick(picture(scene), painter.project, painter.labels(), ball) == Hit(label=words)


def test_lines_are_drawn_on_the_floor():
    scene = floor() + PWay((3.0, 9.0), (4.0, 4.0))
    painter, pixels = drawn(scene)
    x, y = at(painter, 6.0, 4.0, 0.02).astype(int)
    assert pixels[y, x] == pytest.approx([170, 0, 0], abs=12)


def test_a_line_that_is_a_detail_of_a_disc_lies_on_it():
    body = Discs(
        *(np.array([value]) for value in (1.0, 1.0, 0.0, 0.5, 0.3)),
        np.zeros((1, 3), np.uint8), np.array([False]), ("",), ("a",),
    )  # fmt: skip
    lines = picture(PWay((0.9, 1.1), (1.0, 1.2)) + PWay((0.9, 9.1), (1.0, 1.2))).items
    ears, way = (type(line)(line.points, line.form, "a") for line in lines)
    assert [line.level > 0.3 for line in raised_lines(Picture((body, ears, way)), 0.01)] == [
        True,
        False,
    ]
    assert [line.level for line in raised_lines(Picture((ears, body)), 0.01)] == [0.01]


def test_a_ribbon_keeps_its_width_and_counts_its_metres():
    aside, along = ribbon(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0]]))
    assert along.tolist() == [0.0, 2.0, 5.0]
    assert aside == pytest.approx(np.array([[0, 1], [-1, 1], [-1, 0]]))


def test_beams_and_the_selected_agent_are_shown():
    scene = floor() + TPut(6.0, 4.0)(PRobot("r1", 0.3))
    shown = picture(scene)
    (discs,) = shown.of(Discs)
    robot_disc = Discs(*(getattr(discs, name) for name in discs.__slots__[:8]), ("r1",))
    beams = Beams(6.0, 4.0, np.array([[6.0, 7.0], [7.0, 7.0]]), np.array([True, True]))
    painter, before = drawn(scene)
    painter.draw(Sight(Picture((*shown.items[:1], robot_disc)), (beams,), selected="r1"))
    changed = (painter.pixels() != before).any(axis=2)
    x, y = at(painter, 6.02, 6.0, 0.2).astype(int)
    assert changed[y - 2 : y + 3, x - 2 : x + 3].any()
    ring = at(painter, 6.0 - 0.45, 4.0, 0.0).astype(int)
    assert changed[ring[1] - 2 : ring[1] + 3, ring[0] - 2 : ring[0] + 3].any()


def test_the_followed_agent_is_in_the_middle():
    scene = floor() + TPut(9.0, 2.0)(PRobot("r1", 0.3))
    shown = picture(scene)
    (discs,) = shown.of(Discs)
    robot_disc = Discs(*(getattr(discs, name) for name in discs.__slots__[:8]), ("r1",))
    painter, _ = drawn(scene)
    painter.draw(Sight(Picture((*shown.items[:1], robot_disc)), selected="r1", follows=True))
    assert at(painter, 9.0, 2.0, 0.0) == pytest.approx([450, 300], abs=1)


def test_the_mouse_rotates_pans_and_zooms():
    painter, before = drawn(floor())
    place = painter.camera.ground(700, 200, 900, 600)
    painter.zoom(3, (700, 200))
    assert at(painter, *place, 0.0) == pytest.approx([700, 200], abs=0.1)
    painter.drag(50, 0, 3)
    assert at(painter, *place, 0.0) == pytest.approx([750, 200], abs=20)
    turned = painter.camera.azimuth
    painter.drag(100, 0, 1)
    assert painter.camera.azimuth != turned
    painter.fit()
    painter.draw(Sight(picture(floor())))
    assert np.array_equal(before, painter.pixels())


def test_another_size_shows_the_whole_world_too():
    painter, _ = drawn(floor())
    painter.resized((500, 700))
    painter.draw(Sight(picture(floor()), caption="orchard", help=[("h", "help")], notice="said"))
    assert painter.pixels().shape == (700, 500, 3)
    assert 0 < at(painter, 0.0, 0.0, 0.0)[0] < at(painter, 12.0, 8.0, 0.0)[0] < 500


def test_later_figures_cover_earlier_ones():
    scene = floor() + TPut(6.0, 4.0)(PRobot("r1", 0.4)) + TPut(6.1, 4.0)(PRobot("r2", 0.2))
    heights = instances(picture(scene).of(Discs))["size"][:, 1]
    assert heights[1] > heights[0]
    (alone,) = instances(picture(floor() + PRobot("r1", 0.4)).of(Discs))["size"][:, 1]
    assert alone == heights[0]


def test_painters_in_one_process_do_not_disturb_one_another():
    scenes = [floor() + TPut(3.0, 3.0)(PBall(0.4)), floor() + TPut(5.0, 4.0)(PSign("a"))]
    (left, first), (right, second) = (drawn(each) for each in scenes)
    drawn(PBall(1.0))[0].close()
    for painter, scene, pixels in ((right, scenes[1], second), (left, scenes[0], first)):
        painter.draw(Sight(picture(scene)))
        assert np.array_equal(painter.pixels(), pixels)


def test_ten_thousand_discs_are_one_call_and_all_of_them_are_there():
    side = 100
    x, y = (axis.ravel() * 1.0 for axis in np.meshgrid(np.arange(side), np.arange(side)))
    n = side * side
    discs = Discs(
        x, y, np.zeros(n), np.full(n, 0.3), np.full(n, 0.2),
        np.tile(np.array(BALL, np.uint8), (n, 1)), np.full(n, False), [""] * n, ["~b"] * n,
    )  # fmt: skip
    painter, _ = drawn(EMPTY, size=(1000, 1000))
    painter.draw(Sight(Picture((discs,))))
    assert painter._scene._drums.count == n == len(instances([discs]))
    pixels = painter.pixels()
    right, down, _ = painter.project(x, y, discs.height)
    lids = pixels[down.astype(int), right.astype(int)].astype(int)
    assert (lids[:, 2] - lids[:, 0] > 60).all()


def test_an_empty_world_and_strange_numbers_are_drawn_too():
    painter, _ = drawn(EMPTY)
    for scene in (
        PWay((1.0,), (1.0,)) + PWay((), ()),
        PWay((1.0, 1.0), (1.0, 1.0)),
        PMap(np.zeros((0, 4), np.int16), 0.1),
        PSign("") + PSign("a\nb" * 400),
        TPut(1e7, -1e7)(PBall(0.0)),
    ):
        painter.draw(Sight(picture(scene)))
        assert painter.pixels().shape == (600, 900, 3)
