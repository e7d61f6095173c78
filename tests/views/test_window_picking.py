"""The item under the mouse."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from window_world import BUGS, discs, flat

from minerva_services.geometry.picture import Picture
from minerva_services.views.window.painter import Box
from minerva_services.views.window.picking import Hit, first_agent, pick, spot_of

SIGN = Box("attic", 60, 60, 90, 80)
METRES = st.floats(-20, 20)


def test_an_agent_is_picked_on_its_disc_and_a_little_beside_it():
    assert pick(BUGS, flat, [], (100, 100)) == Hit(agent="b1")
    assert pick(BUGS, flat, [], (100, 109)) == Hit(agent="b1")
    assert pick(BUGS, flat, [], (100, 111)) is None
    assert pick(BUGS, flat, [], (128, 100)) == Hit(agent="b2")
    assert pick(Picture(), flat, [], (100, 100)) is None


def test_a_label_is_picked_where_no_agent_is():
    assert pick(BUGS, flat, [SIGN], (75, 70)) == Hit(label="attic")
    assert pick(BUGS, flat, [SIGN], (91, 70)) is None
    over = Picture((discs((-2.5, 3.0)),))
    assert pick(over, flat, [SIGN], (75, 70)) == Hit(agent="b1")
    later = Box("hall", 70, 60, 99, 80)
    assert pick(BUGS, flat, [SIGN, later], (75, 70)) == Hit(label="hall")


def test_scenery_without_an_owner_hides_no_agent():
    tree = discs((0.0, 0.0), owners=[""])
    bug = discs((0.2, 0.0), owners=["b7"])
    assert pick(Picture((bug, tree)), flat, [], (100, 100)) == Hit(agent="b7")
    assert pick(Picture((tree,)), flat, [SIGN], (100, 100)) is None


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearest_of_several_batches_is_picked(order):
    near, far = discs((0.1, 0.0), owners=["near"]), discs((0.6, 0.0), owners=["far"])
    assert pick(Picture((near, far)[::order]), flat, [], (100, 100)) == Hit(agent="near")


def test_an_agent_of_a_population_is_found_by_its_name():
    population = Picture((discs((0.0, 0.0), (3.0, 0.0), owners=["~0"] * 2, names=["p", "q"]),))
    assert pick(population, flat, [], (130, 100)) == Hit(agent="q")
    assert spot_of(population, "q").x == 3.0


def test_points_behind_the_viewer_are_not_picked():
    def behind(x, y, height):
        return np.full(len(x), np.nan), np.full(len(x), np.nan), np.full(len(x), np.nan)

    assert pick(BUGS, behind, [], (100, 100)) is None


@given(st.lists(st.tuples(METRES, METRES), min_size=1, max_size=12), METRES, METRES)
def test_the_nearest_is_picked(places, x, y):
    picture = Picture((discs(*places),))
    px, py = 100 + 10 * x, 100 - 10 * y
    away = [np.hypot(10 * (x - a), 10 * (y - b)) for a, b in places]
    hit = pick(picture, flat, [], (px, py))
    if hit is None:
        assert min(away) >= 10 - 1e-6
    else:
        assert away[int(hit.agent[1:]) - 1] == pytest.approx(min(away), abs=1e-6)


def test_an_agent_is_where_its_disc_with_a_heading_is():
    body = discs((1.0, 1.0), (2.0, 2.0), owners=["a", "b"], heading=False)
    head = discs((5.0, 6.0), owners=["a"], radius=0.25)
    picture = Picture((body, head))
    spot = spot_of(picture, "a")
    assert (spot.x, spot.y, spot.radius) == (5.0, 6.0, 0.25)
    assert spot_of(picture, "b").x == 2.0
    assert spot_of(picture, "c") is None
    assert spot_of(picture, "") is None
    assert first_agent(picture) == "a"
    assert first_agent(Picture()) == ""
