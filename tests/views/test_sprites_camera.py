"""Conversion between places and the screen."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("pygame")

from sprites_world import PDot, PPath, PSign, TPut, floor, picture

from minerva_bus import EMPTY
from minerva_bus.semantics.plane import Bounds
from minerva_services.views.sprites.camera import MapCamera, extent

METRES, PIXELS = st.floats(-1e4, 1e4), st.floats(-5000, 5000)
CAMERAS = st.builds(
    MapCamera, METRES, METRES, st.floats(0.01, 1000), st.tuples(*[st.integers(50, 4000)] * 2)
)


@given(CAMERAS, PIXELS, PIXELS)
def test_a_pixel_of_a_place_is_that_of_the_pixel(camera, right, down):
    x, y = camera.to_world(right, down)
    assert camera.to_screen(x, y) == pytest.approx((right, down), abs=1e-4)


@given(CAMERAS, METRES, METRES)
def test_the_world_is_not_mirrored(camera, x, y):
    right, down = camera.to_screen(x, y)
    assert camera.to_screen(x + 1, y)[0] - right == pytest.approx(camera.scale, abs=1e-3)
    assert camera.to_screen(x, y + 1)[1] - down == pytest.approx(-camera.scale, abs=1e-3)


@given(CAMERAS, PIXELS, PIXELS, st.floats(-5, 5))
def test_the_point_under_the_wheel_stays_there(camera, right, down, steps):
    at = camera.to_world(right, down)
    nearer = camera.zoomed(steps, (right, down), (1e-5, 1e5))
    assert nearer.to_screen(*at) == pytest.approx((right, down), abs=1e-3)
    assert (nearer.scale > camera.scale) == (steps > 0) or steps == pytest.approx(0, abs=1e-9)


@given(CAMERAS, METRES, METRES, PIXELS, PIXELS)
def test_dragged_objects_move_along(camera, x, y, dx, dy):
    right, down = camera.to_screen(x, y)
    there = camera.dragged(dx, dy).to_screen(x, y)
    assert there == pytest.approx((right + dx, down + dy), abs=1e-3)


@given(CAMERAS, METRES, METRES, st.floats(0.1, 1e3), st.floats(0.1, 1e3))
def test_all_of_the_bounds_is_to_be_seen(camera, x, y, across, along):
    bounds = Bounds(x, y, x + across, y + along)
    fitted = camera.fitted(bounds, 10.0)
    left, bottom = fitted.to_screen(bounds.left, bounds.bottom)
    right, top = fitted.to_screen(bounds.right, bounds.top)
    width, height = camera.size
    assert left >= 10 - 1e-3
    assert top >= 10 - 1e-3
    assert right <= width - 10 + 1e-3
    assert bottom <= height - 10 + 1e-3
    assert min(left - 10, top - 10) == pytest.approx(0, abs=1e-3)


def test_zoom_has_limits():
    camera = MapCamera(scale=100.0)
    assert camera.zoomed(999, (0, 0), (1.0, 5000.0)).scale == 5000
    assert camera.zoomed(-999, (0, 0), (1.0, 5000.0)).scale == 1


def test_the_extent_is_that_of_the_floor_where_there_is_one():
    far = TPut(50.0, 50.0)(PDot(1.0))
    area = extent(picture(floor() + far))
    assert (area.left, area.bottom, area.right, area.top) == pytest.approx((0, 0, 8, 5))


def test_else_of_all_and_it_only_grows():
    first = extent(picture(TPut(1.0, 0.0)(PDot(0.1)) + TPut(9.0, 0.0)(PDot(0.1))))
    assert first.left < 0.9
    assert first.right > 9.1
    assert extent(picture(TPut(5.0, 0.0)(PDot(0.1))), first) == first
    wider = extent(picture(TPut(20.0, 0.0)(PDot(0.1))), first)
    assert wider.left == first.left
    assert wider.right > 20
    assert extent(picture(EMPTY), first) == first
    assert extent(picture(EMPTY)) is None


def test_a_lone_disc_does_not_fill_the_screen():
    area = extent(picture(PDot(0.2)))
    assert area.right - area.left > 1.0


def test_lines_and_signs_count():
    area = extent(picture(PPath((0.0, 4.0), (0.0, 2.0)) + PSign("a")))
    assert area.right > 4
    assert extent(picture(PPath((), ()))) is None
