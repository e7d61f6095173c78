"""Geometry of a page: its camera, targets of clicks, and the outer surfaces of solids."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from web_world import FLOOR, PFloor, PStone, PWay, cart, named, picture, slot

pytest.importorskip("viser")

from minerva_bus import Line
from minerva_bus.semantics.plane import Bounds
from minerva_services.geometry.picture import Copies, Discs, Polyline, Texts
from minerva_services.views.solids import (
    arrow,
    cylinder,
    disc_table,
    flat,
    pin,
    ring,
    segments,
    walls,
)
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
    return clicked(
        eye, at - eye, disc_table(shown.of(Discs)), shown.of(Copies), shown.of(Texts), height
    )


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


masks = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=7))


def triangles(solid):
    return solid.vertices[solid.faces].astype(float)


def normals(solid):
    """The normals, with twice the triangle's area as length."""
    a, b, c = np.moveaxis(triangles(solid), 1, 0)
    return np.cross(b - a, c - a)


def area(solid):
    return np.linalg.norm(normals(solid), axis=1).sum() / 2


@given(masks)
def test_a_floor_covers_its_cells_and_is_seen_from_above(mask):
    ground = flat(mask, 0.5, 0.25)
    assert area(ground) == pytest.approx(0.25 * mask.sum(), abs=1e-5)
    assert (normals(ground)[:, 2] >= 0).all()
    assert not len(ground.vertices) or set(ground.vertices[:, 2].tolist()) == {0.25}


@given(masks)
def test_walls_have_a_side_for_each_edge_and_are_seen_from_outside(mask):
    built = walls(mask, 1.0, 2.0)
    padded = np.pad(mask, 1).astype(int)
    edges = sum(np.abs(np.diff(padded, axis=axis)).sum() for axis in (0, 1))
    assert area(built) == pytest.approx(mask.sum() + 2.0 * edges, abs=1e-4)
    upright = normals(built)
    standing = np.abs(upright[:, 2]) < 1e-9
    middles = triangles(built)[standing].mean(axis=1)
    ways = upright[standing] / np.linalg.norm(upright[standing], axis=1, keepdims=True)
    for middle, way in zip(middles, ways, strict=True):
        for step, solid in ((0.1, False), (-0.1, True)):
            row, column = np.floor((middle + step * way)[:2]).astype(int) + 1
            assert bool(padded[row, column]) == solid


@pytest.mark.parametrize("solid", [cylinder(8), cylinder(32), pin()])
def test_round_solids_are_seen_from_outside(solid):
    middles = triangles(solid).mean(axis=1) - (0.0, 0.0, 0.5)
    ways = normals(solid)
    upright = np.abs(ways[:, 2]) < 1e-6
    assert ((ways * middles)[upright, :2].sum(axis=1) > 0).all()
    assert solid.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    assert solid.vertices[:, 2].max() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("solid", [arrow(), ring()])
def test_marks_lie_flat_and_face_up(solid):
    assert (normals(solid)[:, 2] > 0).all()


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=2, max_size=6),
    st.booleans(),
)
def test_lines_and_their_dashes_lie_along_the_points(points, dashed):
    line = Polyline(np.array(points), Line("xs", "ys", dashed=dashed))
    length = np.hypot(*np.diff(line.points, axis=0).T).sum()
    drawn = segments(line)
    assert drawn.shape[1:] == (2, 3)
    parts = np.linalg.norm(np.diff(drawn.astype(float), axis=1)[:, 0], axis=1).sum()
    assert parts <= length + 1e-3
    if not dashed:
        assert parts == pytest.approx(length, abs=1e-3)
