"""The order in which a picture of solids is painted, from far to near.

Faces of large solids, such as walls, divide space: what lies behind the plane of a face is painted
before it, and what lies in front of it after. A face on both sides is cut. Small solids are painted
whole, so they are on the side of their centre, and those between the same planes are in the order
of their distance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A flat face: its corners (n, 3), the plane `normal · x = offset`, its area and its colour.

    The normal points to the side from which the face is seen.
    """

    corners: Floats
    normal: Floats
    offset: float
    area: float
    fill: str


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """A small solid: its centre (3,), its place in the order, and what paints it."""

    centre: Floats
    rank: tuple[bool, float]
    shapes: tuple[str, ...]


def face_of(corners: Floats, normal: Floats, fill: str) -> Face:
    """A face with a normal of length 1."""
    fan = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0]).sum(axis=0)
    area = float(np.linalg.norm(fan)) / 2
    return Face(corners, normal, float(normal @ corners.mean(axis=0)), area, fill)


def painted(
    faces: Sequence[Face], wholes: Sequence[Whole], tolerance: float
) -> Iterator[Face | Whole]:
    """All faces, or their pieces, and solids, from far to near.

    Args:
        faces: of large solids.
        wholes: small solids.
        tolerance: metres by which a face may be beyond a plane without a cut.

    """
    # The last part is the farthest one. A part that is not divided has the faces of one plane.
    parts = [([*faces], [*wholes], True)]
    while parts:
        faces, wholes, is_divided = parts.pop()
        if not (faces and is_divided):
            yield from faces
            yield from sorted(wholes, key=lambda whole: whole.rank)
            continue
        plane = max(faces, key=lambda face: face.area)
        far, within, near = _divided(faces, plane, tolerance)
        sides = [float(plane.normal @ whole.centre) < plane.offset for whole in wholes]
        behind = [whole for whole, is_behind in zip(wholes, sides, strict=True) if is_behind]
        before = [whole for whole, is_behind in zip(wholes, sides, strict=True) if not is_behind]
        parts += [(near, before, True), (within, [], False), (far, behind, True)]


def _divided(
    faces: Sequence[Face], plane: Face, tolerance: float
) -> tuple[list[Face], list[Face], list[Face]]:
    """The faces behind a plane, in it and before it; those on both sides are cut."""
    heights = np.concatenate([face.corners for face in faces]) @ plane.normal - plane.offset
    sizes = [len(face.corners) for face in faces]
    starts = np.concatenate(([0], np.cumsum(sizes)[:-1]))
    lows = np.minimum.reduceat(heights, starts).tolist()
    highs = np.maximum.reduceat(heights, starts).tolist()
    far, within, near = list[Face](), list[Face](), list[Face]()
    for face, start, low, high in zip(faces, starts.tolist(), lows, highs, strict=True):
        if face is plane or (-tolerance <= low and high <= tolerance):
            within.append(face)
        elif -tolerance <= low:
            near.append(face)
        elif high <= tolerance:
            far.append(face)
        else:
            own = heights[start : start + len(face.corners)]
            near.append(_piece(face, own))
            far.append(_piece(face, -own))
    return far, within, near


def _piece(face: Face, heights: Floats) -> Face:
    """The part of a face whose corners have heights from 0."""
    corners = list[Floats]()
    for at in range(len(heights)):
        here, there = face.corners[at - 1], face.corners[at]
        low, high = heights[at - 1], heights[at]
        if (low < 0) != (high < 0):
            corners.append(here + (there - here) * (low / (low - high)))
        if high >= 0:
            corners.append(there)
    return face_of(np.array(corners), face.normal, face.fill)
