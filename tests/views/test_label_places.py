"""Labels keep apart, within the picture and within their room."""

import numpy as np
import pytest

from minerva_bus.semantics.poses import Pose
from minerva_services.views.layout import MAX_PLACED, LabelPlaces, cells_at

PAGE = (0.0, 0.0, 400.0, 300.0)


def beside(x, y):
    """Places of a label of 60 × 20 pixels: right, left, above, below."""
    corners = ((x + 10, y - 20), (x - 70, y - 20), (x - 30, y - 50), (x - 30, y + 5))
    return [(left, top, left + 60, top + 20) for left, top in corners]


@pytest.mark.parametrize(
    ("point", "taken", "wall", "place"),
    [
        ((200, 100), [], None, 0),
        ((390, 100), [], None, 1),
        ((200, 100), [(220, 70, 300, 120)], None, 1),
        ((200, 100), [(100, 80, 190, 100), (210, 80, 300, 100)], None, 2),
        ((200, 100), [], 240, 1),
        ((200, 100), [(100, 80, 190, 100), (150, 30, 250, 75)], 240, 3),
    ],
    ids=["free", "edge", "another", "two", "wall", "all"],
)
def test_a_label_takes_the_first_place_that_is_free(point, taken, wall, place):
    def ground(right, down):
        return np.where((right > wall) & (right < wall + 8), 1.0, 0.0)

    places = LabelPlaces(PAGE, taken, None if wall is None else ground)
    assert places.choose(beside(*point), *point) == place


def test_labels_at_one_point_are_apart():
    places = LabelPlaces(PAGE, [], None)
    assert [places.choose(beside(200, 100), 200, 100) for _ in range(4)] == [0, 1, 2, 3]


def test_many_labels_take_no_time_to_compare():
    places = LabelPlaces(PAGE, [], None)
    chosen = [places.choose(beside(200, 100), 200, 100) for _ in range(MAX_PLACED + 5)]
    assert chosen[MAX_PLACED:] == [0] * 5


def test_cells_of_a_turned_matrix():
    cells = np.arange(6).reshape(2, 3)
    x, y = np.array([-0.25, -1.25, 5.0]), np.array([0.25, 0.75, 0.0])
    values = cells_at(cells, Pose(0.0, 0.0, 90.0), 0.5, x, y)
    assert values[:2].tolist() == [0.0, 5.0]
    assert np.isnan(values[2])
