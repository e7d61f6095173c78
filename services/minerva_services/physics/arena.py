"""A flat world of walls, markers and round bodies that drive, collide and sense.

Driving is kinematic: a body goes exactly where its command leads, or stops exactly where it
touches. Dead reckoning by an agent therefore never drifts from this world, and its bodies are the
whole state between two steps.

`ArenaState` synchronises an arena with views: it adds what is new and removes what is gone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from minerva_bus import portable
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Sighting
from minerva_services.physics.body import (
    Body,
    DriveCommand,
    DriveOutcome,
    Odometer,
)
from minerva_services.physics.encounters import (
    TOLERANCE,
    Contact,
    MovingDisc,
    Point,
    contact,
    contacts,
    offset,
    settle,
)
from minerva_services.physics.errors import PhysicsError, finite, positive
from minerva_services.physics.geometry import FloorPlan, PhysicalGeometry, Robot
from minerva_services.physics.obstacles import Obstacles
from minerva_services.physics.sensors import Distances, camera, laser
from minerva_services.physics.walls import Segments, wall_segments


class Arena:
    """Static walls and markers, and bodies that are added, driven and removed.

    Units are metres, seconds and degrees; angles are counter-clockwise from +x. Methods that take a
    body's name raise `PhysicsError` if it does not exist.
    """

    def __init__(self) -> None:
        self._obstacles = Obstacles()
        self._markers: dict[str, Point] = {}
        self._bodies: dict[str, Body] = {}
        self._commands: dict[str, DriveCommand] = {}

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies' names, sorted."""
        return tuple(sorted(self._bodies))

    @property
    def markers(self) -> tuple[str, ...]:
        """The markers' names, sorted."""
        return tuple(sorted(self._markers))

    def add_walls(self, segments: Segments, *, solid_behind: bool = False) -> None:
        """Add walls without thickness that block bodies and rays from both sides.

        Args:
            segments: (n, 4) rows `ax, ay, bx, by` in metres.
            solid_behind: the walls are outlines as returned by `wall_segments`: no body may be
              placed to the right of a → b, at any distance from the wall.

        Raises:
            PhysicsError: wrong shape, a number that is not finite, or a wall of length 0.

        """
        if segments.ndim != 2 or segments.shape[1] != 4:
            raise PhysicsError(f"walls: expected rows of ax, ay, bx, by, found {segments.shape}")
        walls: list[tuple[float, float, float, float]] = [
            (ax, ay, bx, by) for ax, ay, bx, by in segments.tolist()
        ]
        # All walls are checked before the first one is added, so an error leaves the arena
        # unchanged.
        for wall in walls:
            finite("walls", *wall)
            if wall[:2] == wall[2:]:
                raise PhysicsError(f"walls: a wall at {wall[:2]} has no length")
        for wall in walls:
            self._obstacles.add_wall(wall, solid_behind=solid_behind)

    def remove_walls(self) -> None:
        """Remove all walls."""
        self._obstacles.remove_walls()

    def add_marker(self, name: str, x: float, y: float) -> None:
        """Add a marker that cameras recognise; within 1 mm of a wall's surface it stays visible.

        Raises:
            PhysicsError: the name is taken, or the position is not finite.

        """
        finite(f"marker {name!r}, place", x, y)
        if name in self._markers:
            raise PhysicsError(f"marker {name!r} exists already; give each marker a unique name")
        self._markers[name] = (float(x), float(y))

    def remove_markers(self) -> None:
        """Remove all markers."""
        self._markers.clear()

    def add_body(self, name: str, x: float, y: float, angle: float, radius: float) -> None:
        """Add a disc with a radius in metres in free space.

        Raises:
            PhysicsError: the name is taken, a number is invalid, or the position is not free.

        """
        finite(f"body {name!r}, pose", x, y, angle)
        positive(f"body {name!r}, radius in metres", radius)
        if name in self._bodies:
            raise PhysicsError(f"body {name!r} exists already; give each body a unique name")
        body = Body(Pose(float(x), float(y), float(angle)), float(radius))
        self._refuse_solid(name, body)
        self._refuse_touching(name, body)
        self._bodies[name] = body
        self._obstacles.put_disc(name, body.centre, body.radius)

    def put_body(self, name: str, body: Body) -> None:
        """Add a body where another arena had it, without checks."""
        self._bodies[name] = body
        self._obstacles.put_disc(name, body.centre, body.radius)

    def body(self, name: str) -> Body:
        """A body as it is now."""
        return self._body(name)

    def remove_body(self, name: str) -> None:
        """Remove a body together with its pending command."""
        self._body(name)
        del self._bodies[name]
        self._commands.pop(name, None)
        self._obstacles.remove_disc(name)

    def pose(self, name: str) -> Pose:
        """A body's pose."""
        return self._body(name).pose

    def radius(self, name: str) -> float:
        """A body's radius in metres."""
        return self._body(name).radius

    def odometer(self, name: str) -> Odometer:
        """A body's odometer: distance driven and number of stops."""
        return self._body(name).odometer

    def drive(self, name: str, turn_degrees: float, forward_m: float) -> None:
        """Command a body for the next step: turn on the spot, then drive along the new heading.

        Raises:
            PhysicsError: a number is not finite, or the body already has a command for this step.

        """
        self._body(name)
        finite(f"body {name!r}, command", turn_degrees, forward_m)
        if name in self._commands:
            raise PhysicsError(f"body {name!r} already has a command for this step; step first")
        self._commands[name] = DriveCommand(float(turn_degrees), float(forward_m))

    def turn(self, name: str, degrees: float) -> None:
        """Turn a body on the spot immediately: an effect of the last step, not a command.

        Raises:
            PhysicsError: the turn is not finite.

        """
        finite(f"body {name!r}, turn in degrees", degrees)
        if degrees:
            self._bodies[name] = self._body(name).turned(degrees)

    def step(self, dt: float) -> tuple[DriveOutcome, ...]:
        """Carry out all commands at the same time, each at a constant speed.

        Args:
            dt: the step's duration in seconds. Commands are distances, so it has no effect.

        Returns:
            One outcome for each commanded body, sorted by name. The new pose of a body is what
            `turned_deg` and then `moved_m` give by dead reckoning, to the last bit:
            `angle += turned`, `x += moved * cos(radians(angle))`, `y += moved * sin(...)`.

        Raises:
            PhysicsError: the duration is not a finite number above 0.

        """
        positive("step, duration in seconds", dt)
        commands, self._commands = self._commands, {}
        # Turns come first: a move follows the new heading, and a disc that turns on the spot
        # touches nothing new.
        for name, command in commands.items():
            self._bodies[name] = self._bodies[name].turned(command.turn_deg)
        ends, touched = self._ends(commands)
        return tuple(
            self._carry_out(name, commands[name], ends[name], touched.get(name))
            for name in sorted(commands)
        )

    def scan(
        self, name: str, beams: int, first_deg: float, step_deg: float, range_max: float
    ) -> Distances:
        """Cast a planar laser from a body's centre.

        Args:
            name: the body; its own disc is invisible to the laser.
            beams: number of beams.
            first_deg: direction of beam 0 in degrees from the heading.
            step_deg: degrees between beams, counter-clockwise.
            range_max: range in metres.

        Returns:
            (beams,) distances in metres to the nearest wall or other body; `range_max` if none.

        Raises:
            PhysicsError: a negative number of beams, or an invalid number.

        """
        pose = self._body(name).pose
        finite("laser, directions in degrees", first_deg, step_deg)
        positive("laser, range in metres", range_max)
        if beams < 0:
            raise PhysicsError(f"laser: expected 0 beams or more, found {beams}")
        angles = (first_deg + beam * step_deg for beam in range(beams))
        return laser(pose, angles, range_max, self._obstacles.ray_of(name))

    def visible(self, name: str, fov_deg: float, range_max: float) -> tuple[Sighting, ...]:
        """The markers that a camera at a body's centre sees, sorted by name.

        Args:
            name: the body; it does not occlude its own camera.
            fov_deg: full field of view in degrees, centred on the heading, edges included.
            range_max: range in metres, inclusive.

        Raises:
            PhysicsError: a field of view or range that is not a finite number above 0.

        """
        pose = self._body(name).pose
        positive("camera, field of view in degrees", fov_deg)
        positive("camera, range in metres", range_max)
        return camera(pose, self._markers, fov_deg, range_max, self._obstacles.ray_of(name))

    def _body(self, name: str) -> Body:
        if name not in self._bodies:
            raise PhysicsError(f"there is no body {name!r}; existing bodies: {list(self.bodies)}")
        return self._bodies[name]

    def _refuse_solid(self, name: str, body: Body) -> None:
        depth = self._obstacles.depth_in_solid(body.centre)
        # With its centre behind an outline, the disc has to travel the whole depth and its radius
        # to be free; otherwise only the part that crosses a wall counts.
        overlap = depth + body.radius if depth else self._overlap_with_walls(body)
        if overlap > TOLERANCE:
            raise PhysicsError(
                f"body {name!r} of radius {body.radius:g} m at ({body.pose.x:g}, {body.pose.y:g}) "
                f"is inside a wall; the nearest free position is at least {overlap:.3f} m away"
            )

    def _overlap_with_walls(self, body: Body) -> float:
        walls = self._obstacles.walls_near(body.centre, body.centre, body.radius)
        gaps = (portable.hypot(*offset(body.centre, wall)) for wall in walls)
        return body.radius - min(gaps, default=body.radius)

    def _refuse_touching(self, name: str, body: Body) -> None:
        for other, there in sorted(self._bodies.items()):
            overlap = body.radius + there.radius - portable.dist(body.centre, there.centre)
            if overlap > TOLERANCE:
                raise PhysicsError(
                    f"body {name!r} at ({body.pose.x:g}, {body.pose.y:g}) overlaps body {other!r} "
                    f"by {overlap:.3f} m"
                )

    def _ends(
        self, commands: Mapping[str, DriveCommand]
    ) -> tuple[dict[str, float], dict[str, Contact]]:
        """Fraction of its move, 0 to 1, that each body completes, and what stops it before 1."""
        # Bodies without a command are obstacles, so they have a course as well, of length 0.
        forward = {name: command.forward_m for name, command in commands.items()}
        courses = {name: body.course(forward.get(name, 0)) for name, body in self._bodies.items()}
        walls = dict.fromkeys(courses, 1.0)
        driven = [name for name in commands if forward[name]]
        walls |= {name: self._end_at_walls(courses[name]) for name in driven}
        ends, stopped_by = settle(courses, walls, self._near_pairs(courses, driven))
        return ends, contacts(courses, driven, ends, stopped_by, self._obstacles.walls_near)

    def _end_at_walls(self, course: MovingDisc) -> float:
        walls = self._obstacles.walls_near(course.start, course.at(1), course.radius)
        stops = (contact(course.start, course.move, wall, course.radius) for wall in walls)
        return min(1.0, min(stops, default=1.0))

    def _near_pairs(
        self, courses: Mapping[str, MovingDisc], driven: Iterable[str]
    ) -> set[tuple[str, str]]:
        """Pairs of bodies of which at least one drives and that may touch in this step."""
        longest = max((portable.hypot(*courses[name].move) for name in driven), default=0.0)
        pairs: set[tuple[str, str]] = set()
        for name in driven:
            here = courses[name]
            # The other body may approach by as much as the longest move of all; its radius is
            # already part of its box in the index.
            margin = here.radius + longest
            for other in self._obstacles.discs_near(name, here.start, here.at(1), margin):
                # Two driving bodies find each other, so the order within the pair makes it one.
                pairs.add((name, other) if name < other else (other, name))
        return pairs

    def _carry_out(
        self, name: str, command: DriveCommand, end: float, touched: Contact | None
    ) -> DriveOutcome:
        moved, collided = command.forward_m * end, end < 1
        # The distance driven decides, not the point of contact: dead reckoning from `moved_m` then
        # gives the same bits.
        body = self._bodies[name].driven(moved, collided=collided)
        self._bodies[name] = body
        self._obstacles.move_disc(name, body.centre)
        shortfall = abs(command.forward_m - moved)
        return DriveOutcome(name, moved, shortfall, command.turn_deg, collided, touched)


class ArenaState:
    """An arena that follows the views.

    The arena is authoritative for poses: a view adds new bodies, but never moves existing ones.

    Attributes:
        arena: the arena.
        retired_um: metres driven by bodies that were removed, in whole micrometres, so that the
            order in which they are added up does not matter.
        retired_collisions: their collisions.

    """

    def __init__(self, counts: Callable[[str], bool] = lambda _: True) -> None:
        """`counts`: whether a body counts in totals; that of another process counts there."""
        self.arena = Arena()
        self._counts = counts
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
        """Totals over all bodies that count, including removed ones."""
        names = filter(self._counts, self.arena.bodies)
        odometers = [self.arena.odometer(name) for name in names]
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
        if self._counts(name):
            done = self.arena.odometer(name)
            self.retired_um += _micrometres(done)
            self.retired_collisions += done.collisions
        self.arena.remove_body(name)


def _micrometres(odometer: Odometer) -> int:
    return round(odometer.driven_m * 1e6)
