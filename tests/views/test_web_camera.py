"""The camera of a page, and the targets of clicks."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from web_world import FLOOR, PFloor, PStone, PWay, cart, named, picture, slot

pytest.importorskip("viser")

from minerva_bus.semantics.bounds import Bounds
from minerva_bus.semantics.picture import Discs, Texts
from minerva_services.views.disc_table import disc_table
from minerva_services.views.web.camera_control import FIELD, CameraControl, bounds_of, camera_pose
from minerva_services.views.web.picking import Clicked, clicked

sides = st.floats(0.01, 1e4)


def on_screen(seen, aspect, point):
    """The position of a point on the screen, from -1 to 1; the camera looks north and down."""
    eye, aim = np.array(seen.position), np.array(seen.look_at)
    ahead = (aim - eye) / np.linalg.norm(aim - eye)
    right = np.array([1.0, 0.0, 0.0])
    to = np.array(point) - eye
    depth, tall = to @ ahead, math.tan(FIELD / 2)
    return to @ right / depth / tall / aspect, to @ np.cross(right, ahead) / depth / tall


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), sides, sides, st.floats(0, 3), st.floats(0.3, 3))
def test_the_whole_world_is_in_sight_and_fills_the_page(left, bottom, width, depth, height, aspect):
    seen = camera_pose(Bounds(left, bottom, left + width, bottom + depth), height, aspect)
    places = [
        on_screen(seen, aspect, (x, y, z))
        for x in (left, left + width)
        for y in (bottom, bottom + depth)
        for z in (0.0, height)
    ]
    assert np.abs(places).max() < 1.0
    if max(width, depth) > 1.0:
        assert np.abs(places).max() > 0.85


class WindowCamera:
    """The camera of a window whose shape changes while it is read."""

    def __init__(self, *aspects):
        self.aspects = list(aspects)
        self.position, self.look_at = (0.0, 0.0, 9.0), (0.0, 0.0, 0.0)
        self.update = None

    @property
    def aspect(self):
        return self.aspects.pop(0) if len(self.aspects) > 1 else self.aspects[0]

    def on_update(self, update):
        self.update = update


def test_a_camera_follows_a_window_that_changes_while_it_is_positioned():
    camera, called = WindowCamera(2.0), {}
    server = SimpleNamespace(
        initial_camera=SimpleNamespace(),
        get_clients=dict,
        on_client_connect=lambda connect: called.update(connect=connect),
        on_client_disconnect=lambda disconnect: called.update(disconnect=disconnect),
    )
    bounds = Bounds(0.0, 0.0, 8.0, 4.0)
    CameraControl(server).fit(bounds, 1.0)
    called["connect"](SimpleNamespace(client_id=1, camera=camera))
    assert camera.position == camera_pose(bounds, 1.0, 2.0).position
    # The window has become narrow, and is wide again as soon as its camera is positioned.
    for _ in range(3):
        camera.aspects = [0.5, 0.5, 2.0]
        camera.update(camera)
        camera.update(camera)
        assert camera.position == camera_pose(bounds, 1.0, 2.0).position


def test_bounds_are_around_all_that_is_shown():
    scene = PFloor(FLOOR) + PWay((5.0, 6.0), (1.0, -2.0)) + named("inn", -1.0, 0.0)
    assert bounds_of(picture(scene)) == Bounds(-1.0, -2.0, 6.0, 3.0)
    assert bounds_of(picture(PStone(0.5))) == Bounds(-0.5, -0.5, 0.5, 0.5)
    assert bounds_of(picture(slot("ACart", "c"))) is None


def hit(eye, at, shown, height=1.0):
    eye, at = np.array(eye, float), np.array(at, float)
    return clicked(eye, at - eye, disc_table(shown.of(Discs)), shown.of(Texts), height)


def test_a_click_means_the_agent_or_the_text_it_hits():
    shown = picture(
        slot("ACart", "c") + PStone(0.2) + named("inn", 4.0, 4.0) + slot("ACart", "d"),
        c=cart(2.0),
        d=cart(-3.0, 1.0),
    )
    eye = (0.0, -8.0, 9.0)
    assert hit(eye, (2.0, 0.0, 0.15), shown) == Clicked("c", "c")
    assert hit(eye, (-3.0, 1.0, 0.2), shown) == Clicked("d", "d")
    assert hit(eye, (4.0, 4.0, 0.8), shown) == Clicked(text="inn")
    assert hit(eye, (0.0, 0.0, 0.1), shown) is None  # scenery
    assert hit(eye, (1.0, 2.0, 0.0), shown) is None
    assert hit(eye, (-4.0, -16.0, 18.0), shown) is None  # behind the eye


def test_far_away_a_click_may_miss_by_some_pixels():
    shown = picture(slot("ACart", "c"), c=cart(0.0))
    assert hit((0.0, -60.0, 60.0), (0.7, 0.0, 0.1), shown) == Clicked("c", "c")
    assert hit((0.0, -6.0, 6.0), (0.7, 0.0, 0.1), shown) is None
