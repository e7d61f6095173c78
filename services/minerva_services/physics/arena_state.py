"""Synchronises an arena with views: adds what is new, removes what is gone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from minerva_services.physics.arena import Arena
from minerva_services.physics.body import Body, Odometer
from minerva_services.physics.errors import PhysicsError
from minerva_services.physics.geometry import FloorPlan, PhysicalGeometry, Robot
from minerva_services.physics.sweep import Point
from minerva_services.physics.walls import wall_segments


class ArenaState:
    """An arena that follows the views.

    The arena is authoritative for poses: a view adds new bodies, but never moves existing ones.

    Attributes:
        arena: the arena.
        retired_um: metres driven by bodies that were removed, in whole micrometres, so that the
            order in which they are added up does not matter.
        retired_collisions: their collisions.

    """

    def __init__(self) -> None:
        self.arena = Arena()
        self.retired_um = 0
        self.retired_collisions = 0
        self._floors: tuple[FloorPlan, ...] = ()
        self._markers: dict[str, Point] = {}

    def set(self, seen: PhysicalGeometry) -> None:
        """Update the arena to the contents of a view.

        Raises:
            PhysicsError: something cannot stand where the view shows it.

        """
        # Walls first, because new bodies are checked against the walls of this view.
        self._set_floors(seen.floors)
        self._set_markers(seen.markers)
        self._set_bodies(seen.robots)

    def restore(self, bodies: Mapping[str, Body]) -> None:
        """Replace all bodies."""
        for name in self.arena.bodies:
            self.arena.remove_body(name)
        for name, body in sorted(bodies.items()):
            self.arena.put_body(name, body)

    def total(self) -> Odometer:
        """Totals over all bodies, including removed ones."""
        odometers = [self.arena.odometer(name) for name in self.arena.bodies]
        driven = self.retired_um + sum(_micrometres(each) for each in odometers)
        collisions = sum(odometer.collisions for odometer in odometers)
        return Odometer(driven / 1e6, self.retired_collisions + collisions)

    def _set_floors(self, floors: Sequence[FloorPlan]) -> None:
        # Building the outlines and their index again for each view would cost far more than this
        # comparison.
        if len(floors) == len(self._floors) and all(map(FloorPlan.same_as, floors, self._floors)):
            return
        self.arena.remove_walls()
        for floor in floors:
            at = floor.corner
            walls = wall_segments(floor.cells, floor.resolution, at.x, at.y, at.angle)
            self.arena.add_walls(walls, solid_behind=True)
        self._floors = tuple(floors)

    def _set_markers(self, markers: Mapping[str, Point]) -> None:
        if markers == self._markers:
            return
        self.arena.remove_markers()
        for name, (x, y) in markers.items():
            self.arena.add_marker(name, x, y)
        self._markers = dict(markers)

    def _set_bodies(self, robots: Mapping[str, Robot]) -> None:
        # Departed bodies go first, so that a new body may take their place.
        for name in self.arena.bodies:
            if name not in robots:
                self._retire(name)
        present = frozenset(self.arena.bodies)
        for name, robot in sorted(robots.items()):
            if name not in present:
                at = robot.believed
                self.arena.add_body(name, at.x, at.y, at.angle, robot.radius)
            elif self.arena.radius(name) != robot.radius:
                raise PhysicsError(
                    f"body {name!r} has a radius of {self.arena.radius(name):g} m that cannot"
                    f" change to {robot.radius:g} m"
                )

    def _retire(self, name: str) -> None:
        done = self.arena.odometer(name)
        self.retired_um += _micrometres(done)
        self.retired_collisions += done.collisions
        self.arena.remove_body(name)


def _micrometres(odometer: Odometer) -> int:
    return round(odometer.driven_m * 1e6)
