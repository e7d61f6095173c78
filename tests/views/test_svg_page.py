"""The part of the world that a picture shows, and its scale."""

import numpy as np
import pytest
from svg_world import VOCABULARY, PBall, PMap, PPath, PSign, TMove, page_of

from minerva_bus import EMPTY
from minerva_bus.semantics.bounds import Bounds
from minerva_services.views.svg.page import Page, frame_of


def test_rasters_frame_the_picture():
    scene = TMove(50.0)(PBall(1.0)) + PMap(np.zeros((4, 2), np.int16), 0.5) + PBall(9.0)
    assert frame_of(scene, VOCABULARY) == Bounds(0.0, 0.0, 2.0, 1.0)


def test_without_rasters_everything_is_on_the_picture_with_a_margin():
    frame = frame_of(PPath((0.0, 10.0), (0.0, 8.0)), VOCABULARY)
    assert frame.left < 0 < 10 < frame.right
    assert frame.bottom < 0 < 8 < frame.top


def test_without_rasters_the_frame_only_grows():
    near = frame_of(PPath((0.0, 10.0), (0.0, 8.0)), VOCABULARY)
    assert frame_of(TMove(5.0, 5.0)(PBall(1.0)), VOCABULARY, near) is near
    far = frame_of(TMove(30.0)(PBall(1.0)), VOCABULARY, near)
    assert near.around(far) == far
    assert frame_of(EMPTY, VOCABULARY, far) is far


def test_a_lone_disc_does_not_fill_the_picture():
    frame = frame_of(PBall(0.25), VOCABULARY)
    assert frame.right - frame.left == pytest.approx(8 * 0.25)


def test_y_grows_upwards():
    page = Page(Bounds(0.0, 0.0, 10.0, 10.0), 1000)
    assert page.pixel(0.0, 1.0)[1] < page.pixel(0.0, 0.0)[1] < page.height
    assert page.pixel(1.0, 0.0)[0] > page.pixel(0.0, 0.0)[0]


@pytest.mark.parametrize(("x", "y"), [(1000.0, 0.0), (0.0, 1000.0), (1.0, 1.0)])
def test_no_world_makes_a_picture_too_flat_or_too_tall(x: float, y: float):
    page = page_of(PPath((0.0, x), (0.0, y)))
    assert 0.2 < page.height / page.width < 1.7


def test_a_point_is_enough_for_a_picture():
    frame = page_of(PSign("x")).frame
    assert frame == Bounds(-frame.right, -frame.top, frame.right, frame.top)
    assert 1.0 < frame.right < 2.0


@pytest.mark.parametrize("size", [0.003, 1.0, 30.0, 9000.0])
def test_the_grid_has_round_steps_and_few_lines(size: float):
    page = Page(Bounds(0.0, 0.0, size, size), 1200)
    assert 8 <= size / page.grid_step <= 20
    assert f"{page.grid_step:.0e}"[0] in "125"
