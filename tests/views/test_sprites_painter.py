"""Drawings of lists of forms: correct colours at the correct places."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("pygame")

import pygame
from sprites_world import (
    DOT,
    ROBOT,
    PDot,
    PMap,
    PPath,
    PRobot,
    PSign,
    PUgly,
    TPut,
    drawn,
    floor,
    middle_of,
    picture,
)

from minerva_bus import EMPTY
from minerva_services.geometry.colors import rgb
from minerva_services.geometry.picture import Discs, Picture, Polyline, Tiles
from minerva_services.views.sprites.camera import MapCamera
from minerva_services.views.sprites.matrices import MatrixLayer, averaged, colored
from minerva_services.views.sprites.overlay import grid_step
from minerva_services.views.sprites.painter import SpritePainter
from minerva_services.views.sprites.strokes import dashes
from minerva_services.views.sprites.text import one_line
from minerva_services.views.window.painter import Beams, Sight


def color_at(painter, pixels, x, y):
    right, down = painter.camera.to_screen(x, y)
    return tuple(int(channel) for channel in pixels[round(down), round(right)])


def near(color, wanted, tolerance=14):
    return max(abs(a - b) for a, b in zip(color, wanted, strict=True)) <= tolerance


@settings(max_examples=12)
@given(st.floats(1.6, 7.0), st.floats(0.6, 4.4), st.floats(-360, 360))
def test_a_robot_is_at_its_pose(x, y, angle):
    painter, pixels = drawn(floor() + TPut(x, y, angle)(PRobot("r1", 0.3)))
    right, down = painter.camera.to_screen(x, y)
    middle = middle_of(pixels, ROBOT)
    assert middle is not None
    assert math.hypot(middle[0] - right, middle[1] - down) < 3
    assert middle[2] == pytest.approx(math.pi * (0.3 * painter.camera.scale) ** 2, rel=0.45)


@pytest.mark.parametrize("angle", [0, 30, 90, 200, -45])
def test_its_mark_is_where_it_heads(angle):
    painter, pixels = drawn(floor() + TPut(4.0, 2.5, angle)(PRobot("r1", 0.4)))
    ahead, behind = 0.15, -0.25
    turn = math.radians(angle)
    for way, white in ((ahead, True), (behind, False)):
        place = 4.0 + way * math.cos(turn), 2.5 + way * math.sin(turn)
        color = color_at(painter, pixels, *place)
        assert near(color, (255, 255, 255)) == white
        assert near(color, ROBOT) != white


def test_the_floor_has_its_colours_where_its_cells_are():
    painter, pixels = drawn(floor())
    for x, y, color in ((1.05, 2.0, "#2f3640"), (2.05, 2.0, "#fbfaf6"), (7.95, 3.0, "#2f3640")):
        assert near(color_at(painter, pixels, x, y), rgb(color), 20)
    assert near(color_at(painter, pixels, -0.1, 2.0), rgb("#f4f0e6"), 20)


@settings(max_examples=12)
@given(st.floats(-180, 180), st.floats(-3, 3))
def test_a_floor_may_be_turned(angle, x):
    cells = np.zeros((30, 20), np.int16)
    cells[20, 5] = 100
    painter, pixels = drawn(PMap(cells, 0.2, x, 1.0, angle))
    turn = math.radians(angle)
    across, along = 20.5 * 0.2, 5.5 * 0.2
    place = (
        x + across * math.cos(turn) - along * math.sin(turn),
        1.0 + across * math.sin(turn) + along * math.cos(turn),
    )
    middle = middle_of(pixels, rgb("#2f3640"), 20)
    wanted = painter.camera.to_screen(*place)
    assert math.hypot(middle[0] - wanted[0], middle[1] - wanted[1]) < 6  # the grid's lines cut it


@pytest.mark.parametrize("nearer", [0, 8])
def test_a_floor_that_was_moved_by_hand_is_drawn_as_if_it_were_new(nearer):
    sight = Sight(picture(floor() + TPut(4.0, 2.5)(PRobot("r1", 0.3))))
    painter, fresh = SpritePainter(), SpritePainter()
    for painted in (painter, fresh):
        painted.offscreen((900, 640))
    painter.draw(sight)
    painter.zoom(nearer, painter.camera.to_screen(1.05, 2.5))  # a wall
    painter.draw(sight)
    painter.drag(37, -21, 1)
    painter.draw(sight)
    fresh.drag(0, 0, 1)
    fresh.camera = painter.camera
    fresh.draw(sight)
    assert np.abs(painter.pixels().astype(int) - fresh.pixels()).max() == 0


def test_a_manual_view_stays_until_fit_is_requested():
    painter, first = drawn(floor())
    painter.drag(37, -21, 1)
    camera = painter.camera
    painter.draw(Sight(picture(floor() + PDot(0.1))))
    assert painter.camera == camera
    painter.fit()
    painter.draw(Sight(picture(floor())))
    assert (painter.pixels() == first).all()


def test_a_matrix_that_replaces_another_is_drawn_again():
    ground, (old,), (new,) = (
        MatrixLayer(),
        *(picture(scene).of(Tiles) for scene in (floor(), floor(20, 9))),
    )
    canvas, camera = pygame.Surface((900, 600), 0, 32), MapCamera(4.0, 2.5, 100.0, (900, 600))
    ground.draw(canvas, old, camera)
    keys = [(id(tiles.cells), id(tiles.form)) for tiles in (old, new)]
    ground._cache[keys[1]] = ground._cache.pop(keys[0])
    ground.draw(canvas, new, camera)
    fresh = canvas.copy()
    MatrixLayer().draw(fresh, new, camera)
    assert (pygame.surfarray.array3d(fresh) == pygame.surfarray.array3d(canvas)).all()
    assert ground._cache[keys[1]].image.shape == (20, 9)


def test_small_cells_are_averaged_not_dropped():
    cells = np.zeros((4000, 3000), np.int16)
    cells[::2] = 100  # every other row: all grey at a distance
    painter, pixels = drawn(PMap(cells, 0.01))
    right, down = map(round, painter.camera.to_screen(20.3, 15.3))
    patch = pixels[down : down + 8, right : right + 8].mean(axis=2)
    assert 100 < patch.min() <= patch.max() < 200


def test_colours_of_a_matrix():
    (tiles,) = picture(floor()).of(Tiles)
    cells = np.array([[-5, 0], [1, 100]], np.int16)
    colors = colored(cells, tiles.form)
    assert colors[0, 0].tolist() == [0, 0, 0, 0]
    assert colors[0, 1].tolist() == [*reversed(rgb("#fbfaf6")), 255]
    assert colors[1, 0].tolist() == colors[1, 1].tolist() == [*reversed(rgb("#2f3640")), 255]
    assert averaged(colors, 1).shape == (2, 2)
    assert averaged(colors[:, 1:], 2).shape == (1, 1)


def test_all_instances_are_drawn_in_their_order():
    rows = np.arange(10_000)
    x, y = (rows % 100) * 0.5, (rows // 100) * 0.5
    colors = np.tile(np.array(DOT, np.uint8), (10_000, 1))
    colors[-1] = (250, 0, 0)
    x[-1], y[-1] = x[0], y[0]  # the last is drawn over the first
    discs = Discs(
        x, y, np.zeros(10_000), np.full(10_000, 0.2), np.full(10_000, 0.2), colors,
        np.zeros(10_000, np.bool_), [""] * 10_000, [""] * 10_000,
    )  # fmt: skip
    painter = SpritePainter()
    painter.offscreen((1200, 1100))
    painter.draw(Sight(Picture((discs,))))
    pixels = painter.pixels()
    shown = [
        near(color_at(painter, pixels, a, b), DOT) for a, b in zip(x[1:-1], y[1:-1], strict=True)
    ]
    assert all(shown)
    assert near(color_at(painter, pixels, x[0], y[0]), (250, 0, 0))


def test_lines_go_through_their_points():
    way = PPath((2.0, 6.0, 6.0), (1.0, 1.0, 4.0))
    painter, pixels = drawn(floor() + way)
    for place in ((4.0, 1.0), (6.0, 2.5), (6.0, 1.0)):
        assert near(color_at(painter, pixels, *place), (0xAA, 0, 0), 40)


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=2, max_size=8))
def test_dashes_cover_half_of_a_line(points):
    points = np.array(points)
    total = np.hypot(*np.diff(points, axis=0).T).sum()
    parts = dashes(points, 1.0)
    lengths = [np.hypot(*np.diff(part, axis=0).T).sum() for part in parts]
    assert sum(lengths) <= total + 1e-6
    if total > 1:
        assert abs(sum(lengths) - total / 2) <= 1 + 1e-6


def test_signs_have_places_to_click():
    painter, _ = drawn(floor() + TPut(4.0, 2.5)(PSign("attic")) + TPut(7.9, 1.0)(PSign("hall")))
    attic, hall = painter.labels()
    right, down = painter.camera.to_screen(4.0, 2.5)
    assert attic.text == "attic"
    assert attic.left < right < attic.right
    assert attic.top < attic.bottom == pytest.approx(down)
    assert hall.right <= 900


def test_beams_can_be_seen_and_do_not_hide():
    beams = Beams(4.0, 2.5, np.array([[6.0, 2.5], [5.0, 4.0], [3.0, 3.0]]), np.ones(3, bool))
    painter, pixels = drawn(floor(), beams=[beams])
    beam, ground = color_at(painter, pixels, 5.0, 2.5), color_at(painter, pixels, 5.2, 1.7)
    assert not near(beam, ground)
    assert near(ground, rgb("#fbfaf6"), 20)


def test_the_selected_agent_has_a_ring():
    scene = floor() + TPut(4.0, 2.5)(PDot(0.3))
    lists = picture(scene)
    (tiles, discs) = lists.items
    owned = Discs(
        discs.x, discs.y, discs.angle, discs.radius, discs.height, discs.color, discs.heading,
        discs.names, ["r1"],
    )  # fmt: skip
    painter = SpritePainter()
    painter.offscreen((900, 640))
    painter.draw(Sight(Picture((tiles, owned))))
    without = painter.pixels()
    painter.draw(Sight(Picture((tiles, owned)), selected="r1"))
    assert middle_of(without, rgb("#1f7a8c")) is None
    middle = middle_of(painter.pixels(), rgb("#1f7a8c"))
    assert middle[:2] == pytest.approx(painter.camera.to_screen(4.0, 2.5), abs=2)
    painter.zoom(5, (10, 10))
    painter.draw(Sight(Picture((tiles, owned)), selected="r1", follows=True))
    assert painter.camera.to_screen(4.0, 2.5) == pytest.approx((450, painter.camera.size[1] / 2))


def test_help_and_notice_are_drawn():
    _, plain = drawn(floor())
    _, annotated = drawn(
        floor(), notice="sent eGo", help=[("space", "pause")], caption="a", subtitle="b"
    )
    assert (plain != annotated).any(axis=2).sum() > 1500


@pytest.mark.parametrize(
    "scene",
    [
        EMPTY,
        PUgly(),
        PSign("a\0b\nc" * 100) + PSign(""),
        PMap(np.zeros((0, 3), np.int16), 0.1),
        PMap(np.zeros((3, 3), np.int16), 0.0),
        TPut(1e300, -1e300)(PDot(1e200)) + PDot(1.0),
        floor() + PDot(1e12) + TPut(1e9, 0.0)(PDot(1e3)),
        floor() + PPath((-1e200, 1e200), (0.0, 1e200)),
        PPath((1.0,), (1.0,)),
    ],
)
def test_every_view_of_a_world_is_drawn(scene):
    painter, pixels = drawn(scene, (300, 200))
    painter.zoom(60, (5, 5))
    painter.draw(Sight(picture(scene)))
    painter.zoom(-200, (5, 5))
    painter.draw(Sight(picture(scene)))
    assert pixels.shape == (200, 300, 3)


def test_texts_are_one_line():
    assert one_line("a\0\nb  c") == "a b c"
    assert one_line("x" * 100) == "x" * 59 + "…"


@given(st.floats(1e-3, 1e5))
def test_the_grid_has_a_round_step(scale):
    painter = SpritePainter()
    painter.offscreen((1200, 800))
    camera = painter.camera.zoomed(0, (0, 0), (scale, scale))
    step = grid_step(camera)
    assert f"{step:.0e}"[0] in "125"
    assert 1200 / 20 * 0.99 <= step * camera.scale <= 1200 / 20 * 2.6


def test_a_line_in_a_picture_is_a_line():
    assert picture(PPath((0.0, 1.0), (0.0, 1.0))).of(Polyline)
