"""Walls and discs in a pymunk space: proximity queries and ray casts.

The space serves as a spatial index and is never stepped, so it holds no contacts, velocities or
caches that a restored world would lack.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import pymunk

from minerva_bus import portable
from minerva_services.physics.encounters import Point, Segment, meeting, offset

Ray = Callable[[Point, Point], float]

# Categories of shapes, one bit each, from which the masks of queries are composed.
_PLAIN_WALL: Final = 1
_OUTLINE: Final = 2
_DISC: Final = 4
_FEELER: Final = 8
_NEARBY: Final = 1e-6
"""Radius in metres of feelers: walls for rays, of which a query finds those that a ray touches."""

_WALLS: Final = pymunk.ShapeFilter(mask=_PLAIN_WALL | _OUTLINE)
_OUTLINES: Final = pymunk.ShapeFilter(mask=_OUTLINE)


class Obstacles:
    """An index of wall segments and named discs."""

    def __init__(self) -> None:
        self._space = pymunk.Space()
        self._walls: dict[pymunk.Shape, Segment] = {}
        self._feelers: dict[pymunk.Shape, Segment] = {}
        self._discs: dict[str, pymunk.Circle] = {}
        self._names: dict[pymunk.Shape, str] = {}
        self._groups = 0

    def add_wall(self, wall: Segment, *, solid_behind: bool) -> None:
        """Add a segment of positive length; the area to the right of an outline a → b is solid."""
        ax, ay, bx, by = wall
        shape = pymunk.Segment(self._space.static_body, (ax, ay), (bx, by), radius=0)
        category = _OUTLINE if solid_behind else _PLAIN_WALL
        shape.filter = pymunk.ShapeFilter(categories=category)
        feeler = pymunk.Segment(self._space.static_body, (ax, ay), (bx, by), radius=_NEARBY)
        feeler.filter = pymunk.ShapeFilter(categories=_FEELER)
        self._space.add(shape, feeler)
        self._walls[shape] = self._feelers[feeler] = wall

    def remove_walls(self) -> None:
        """Remove all walls."""
        self._space.remove(*self._walls, *self._feelers)
        self._walls.clear()
        self._feelers.clear()

    def put_disc(self, name: str, centre: Point, radius: float) -> None:
        """Add a disc under a new name."""
        # Shapes of one group ignore each other, so a query in the group of a disc excludes that
        # disc.
        self._groups += 1
        body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        body.position = centre
        shape = pymunk.Circle(body, radius)
        shape.filter = pymunk.ShapeFilter(group=self._groups, categories=_DISC)
        self._space.add(body, shape)
        self._discs[name] = shape
        self._names[shape] = name

    def move_disc(self, name: str, centre: Point) -> None:
        """Move a disc, without any checks."""
        body = _body(self._discs[name])
        body.position = centre
        # Only `Space.step` updates the index by itself, and the space is never stepped.
        self._space.reindex_shapes_for_body(body)

    def remove_disc(self, name: str) -> None:
        """Remove a disc."""
        shape = self._discs.pop(name)
        del self._names[shape]
        self._space.remove(shape, _body(shape))

    def walls_near(self, start: Point, end: Point, margin: float) -> list[Segment]:
        """Walls that overlap the bounding box of two points, grown by a margin in metres."""
        hits = self._space.bb_query(_box(start, end, margin), _WALLS)
        return [self._walls[shape] for shape in hits]

    def discs_near(self, name: str, start: Point, end: Point, margin: float) -> list[str]:
        """Sorted names of the other discs that overlap such a box."""
        others = pymunk.ShapeFilter(group=self._discs[name].filter.group, mask=_DISC)
        hits = self._space.bb_query(_box(start, end, margin), others)
        return sorted(self._names[shape] for shape in hits)

    def ray_of(self, name: str) -> Ray:
        """A function that returns the free fraction (0 to 1) of the line between two points.

        A line that touches a wall ends there. It ignores the disc `name`. Reuse the function for
        many rays, because creating its filter costs as much as a ray.
        """
        query = self._space.segment_query_first
        group = self._discs[name].filter.group
        others = pymunk.ShapeFilter(group=group, mask=_FEELER | _DISC)

        def ray(start: Point, end: Point) -> float:
            hit = query(start, end, 0, others)
            if hit is None:
                return 1.0
            free = self._free(start, end, hit)
            if free is not None:
                return free
            # It only passes a wall nearby.
            met = (
                self._free(start, end, info)
                for info in self._space.segment_query(start, end, 0, others)
            )
            return min((free for free in met if free is not None), default=1.0)

        return ray

    def _free(self, start: Point, end: Point, hit: pymunk.SegmentQueryInfo) -> float | None:
        wall = self._feelers.get(hit.shape) if hit.shape is not None else None
        return hit.alpha if wall is None else meeting(start, end, wall)

    def depth_in_solid(self, point: Point) -> float:
        """Depth in metres of a point behind the outlines; 0 in free space."""
        nearest = self._space.point_query_nearest(point, math.inf, _OUTLINES)
        if nearest is None:
            return 0.0
        depth = portable.hypot(*offset(point, self._walls[nearest.shape]))
        return 0.0 if self._left_of(point, nearest.shape) else depth

    def _left_of(self, point: Point, outline: pymunk.Shape) -> bool:
        """True if the first outline between a point and this outline's middle faces the point.

        The nearest outline alone is ambiguous: at a corner two are equally near and may disagree.
        """
        ax, ay, bx, by = self._walls[outline]
        middle = (ax + bx) / 2, (ay + by) / 2
        beyond = 2 * middle[0] - point[0], 2 * middle[1] - point[1]
        hit = self._space.segment_query_first(point, beyond, 0, _OUTLINES)
        if hit is not None:
            ax, ay, bx, by = self._walls[hit.shape]
        return (bx - ax) * (point[1] - ay) - (by - ay) * (point[0] - ax) > 0


def _box(start: Point, end: Point, margin: float) -> pymunk.BB:
    return pymunk.BB(
        min(start[0], end[0]) - margin,
        min(start[1], end[1]) - margin,
        max(start[0], end[0]) + margin,
        max(start[1], end[1]) + margin,
    )


def _body(shape: pymunk.Shape) -> pymunk.Body:
    body = shape.body
    assert body is not None
    return body
