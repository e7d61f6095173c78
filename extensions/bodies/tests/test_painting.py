"""The order of faces in a picture of solids: on top is what is nearest, by rays."""

import numpy as np
import pytest

from minerva_bodies.painting import Face, Whole, face_of, painted

EYE = np.array([0.4, -0.7, 0.6]) / np.linalg.norm([0.4, -0.7, 0.6])
RIGHT = np.cross([0, 0, 1], EYE) / np.linalg.norm(np.cross([0, 0, 1], EYE))
PLANE = np.array([RIGHT, np.cross(EYE, RIGHT)])
"""The axes of the picture."""
WALLS = [((0, 0, -0.1), (20, 20, 0.1)), ((4, 3, 1), (0.2, 15, 1)), ((-3, -2, 1), (12, 0.2, 1)),
         ((-9, 8, 2), (0.2, 6, 2)), ((0, 0, 3), (0.5, 0.5, 3))]  # fmt: skip
"""A floor, walls that cross and a pillar: middles and half extents."""


def faces_of(middle, half, fill):
    """The three faces of a box towards the eye."""
    faces = list[Face]()
    for axis in range(3):
        normal = np.zeros(3)
        normal[axis] = np.sign(EYE[axis])
        a, b = (axis + 1) % 3, (axis + 2) % 3
        corners = np.tile(np.array(middle, float) + normal * half, (4, 1))
        corners[:, a] += np.array([-1, 1, 1, -1]) * half[a]
        corners[:, b] += np.array([-1, -1, 1, 1]) * half[b]
        faces.append(face_of(corners, normal, fill))
    return faces


def covers(corners, place):
    """Whether a convex polygon of the picture has a place inside."""
    flat = corners @ PLANE.T
    along, to = np.roll(flat, -1, axis=0) - flat, place - flat
    turns = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
    return bool((turns > 0).all() or (turns < 0).all())


def nearest(boxes, place):
    """The number of the box that a ray through a place of the picture meets first."""
    hits = list[tuple[float, int]]()
    for number, (middle, half) in enumerate(boxes):
        ends = (np.array(middle) + np.outer([-1, 1], half) - place @ PLANE) / EYE
        enters, leaves = np.sort(ends, axis=0)
        if enters.max() < leaves.min():
            hits.append((leaves.min(), number))
    return max(hits)[1] if hits else -1


@pytest.mark.parametrize("small", [0, 40])
def test_what_is_nearest_is_painted_last(small):
    rng = np.random.default_rng(4)
    boxes = list(WALLS)
    while len(boxes) < len(WALLS) + small:
        middle, half = (*rng.uniform(-14, 14, 2), 0.4), rng.uniform(0.2, 0.39, 3)
        apart = [(np.abs(np.subtract(middle, m)) > half + h).any() for m, h in boxes]
        if all(apart):
            boxes.append((middle, half))
    large = [face for n, box in enumerate(boxes[:5]) for face in faces_of(*box, str(n))]
    wholes = [
        Whole(np.array(middle), (True, float(EYE @ middle)), (str(n),))
        for n, (middle, _) in enumerate(boxes)
        if n >= 5
    ]
    order = [*painted(large, wholes, 1e-6)]
    shapes = [
        (int(part.fill), [part.corners]) if isinstance(part, Face)
        else (n := int(part.shapes[0]), [face.corners for face in faces_of(*boxes[n], "")])
        for part in order
    ]  # fmt: skip
    for place in rng.uniform(-12, 12, (200, 2)):
        on_top = [n for n, faces in shapes if any(covers(face, place) for face in faces)]
        assert (on_top or [-1])[-1] == nearest(boxes, place), place
