"""Shapes are drawn where the string's transformations lead."""

import random

import numpy as np
import pytest
from svg_world import (
    PBall,
    PInner,
    PMap,
    PPath,
    PRobot,
    PSign,
    PUgly,
    TMove,
    TStill,
    elements,
    page_of,
    picture,
)

from minerva_bus import EMPTY, MinervaError, Scene
from minerva_bus.semantics.poses import Pose

FLOOR = PMap(np.zeros((20, 10), np.int16), 1.0, -5.0, -5.0)


def circles(scene: Scene) -> list[tuple[float, float, float]]:
    """Centre and radius of each disc, in metres of the world."""
    frame = page_of(scene).frame
    return [
        (
            frame.left + float(e.attrib["cx"]),
            frame.bottom + float(e.attrib["cy"]),
            float(e.attrib["r"]),
        )
        for e in elements(picture(scene), "circle")
    ]


def test_a_disc_is_where_nested_transformations_lead():
    scene = FLOOR + TMove(1.0, 2.0, 90.0)(TMove(0.5, 0.0, -45.0, 2.0)(PBall(0.5)))
    there = Pose().then(1.0, 2.0, 90.0, 0.0).then(0.5, 0.0, -45.0, 2.0)
    assert circles(scene) == [pytest.approx((there.x, there.y, 0.5), abs=1e-3)]


def test_poses_compose_and_are_restored_for_any_nesting():
    chance = random.Random(3)
    for _ in range(50):
        motions = [[chance.uniform(-3, 3) for _ in range(4)] for _ in range(chance.randrange(6))]
        scene, there = PBall(0.25), Pose()
        for motion in reversed(motions):
            scene = TMove(*motion)(scene)
        for motion in motions:
            there = there.then(*motion)
        discs = circles(FLOOR + scene + PBall(0.5))
        assert discs[0] == pytest.approx((there.x, there.y, 0.25), abs=1e-3)
        assert discs[1] == pytest.approx((0.0, 0.0, 0.5), abs=1e-3)


def test_a_transformation_without_motion_moves_nothing():
    assert circles(FLOOR + TStill()(PBall(1.0))) == [pytest.approx((0.0, 0.0, 1.0), abs=1e-3)]


def test_the_heading_mark_points_ahead():
    scene = FLOOR + TMove(2.0, 1.0, 90.0)(PRobot())
    frame = page_of(scene).frame
    tip = elements(picture(scene), "polygon")[0].attrib["points"].split()[0]
    x, y = (float(number) for number in tip.split(","))
    assert frame.left + x == pytest.approx(2.0, abs=1e-3)
    assert frame.bottom + y == pytest.approx(1.0 + 0.78 * 0.25, abs=1e-3)


def test_a_line_goes_through_its_points():
    scene = FLOOR + TMove(1.0, 1.0, 90.0)(PPath((0.0, 2.0, 2.0), (0.0, 0.0, 1.0)))
    line = elements(picture(scene), "polyline")[0].attrib
    assert line["points"] == "6,6 6,8 5,8"
    assert line["stroke-linejoin"] == "round"
    assert "stroke-dasharray" in line


def test_a_label_stands_at_its_pixel_and_above_all_else():
    scene = PSign("here") + FLOOR + PRobot()
    document = picture(scene)
    x, y = page_of(scene).pixel(5.0, 5.0)
    assert f"translate({x:.15g} {y:.15g})" in document
    assert document.index("here") > document.index("polygon")


def test_a_label_that_would_leave_the_picture_turns_to_the_left():
    scene = FLOOR + TMove(14.5, 0.0)(PSign("a long way to go"))
    text = next(e for e in elements(picture(scene), "text") if e.text == "a long way to go")
    assert text.attrib["text-anchor"] == "end"


def test_figures_are_drawn_in_the_order_of_the_string():
    document = picture(FLOOR + PBall(1.0) + PPath((0.0, 1.0), (0.0, 1.0)) + PRobot())
    order = [document.index(part) for part in ('#fbfaf6" d=', "#123456", "#aa0000", "#e07a2f")]
    assert order == sorted(order)


def test_a_disc_too_small_to_see_is_drawn_larger():
    scene = PMap(np.zeros((2, 2), np.int16), 1000.0) + PBall(0.1)
    assert circles(scene)[0][2] * page_of(scene).scale == pytest.approx(3.0, abs=0.01)


def test_a_small_place_far_away_is_drawn_to_the_pixel():
    scene = TMove(5e5, 4.5e6)(PBall(0.001) + TMove(0.01)(PBall(0.001)))
    left, right = circles(scene)
    assert right[0] - left[0] == pytest.approx(0.01, abs=1e-4)
    assert float(elements(picture(scene), "circle")[0].attrib["cx"]) < 1.0


def test_a_string_that_draws_nothing_is_an_empty_picture():
    assert elements(picture(EMPTY), "circle") == []
    assert elements(picture(TMove(1.0)(PInner())), "circle") == []


@pytest.mark.parametrize("place", [1e300, -1e300, 1e-300, 1e12])
def test_no_place_is_too_far_for_a_picture(place: float):
    document = picture(TMove(place, place)(PRobot()) + PRobot())
    assert len(elements(document, "circle")) == 2
    assert len(document) < 5000


def test_a_colour_that_is_none_is_refused():
    with pytest.raises(MinervaError, match="is not a colour"):
        picture(PUgly())
