"""A flat world of walls, markers and round bodies that drive, collide and sense.

Driving is kinematic: a body goes exactly where its command says, or stops exactly where it touches.
So a dead-reckoning agent and this world never drift apart, and the state is nothing but what `save`
returns.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from minerva_bus import portable
from minerva_services.physics.body import Body, Command, Odometer, Outcome, Pose
from minerva_services.physics.encounters import Course, settle
from minerva_services.physics.errors import PhysicsError, finite, positive
from minerva_services.physics.obstacles import Obstacles
from minerva_services.physics.saved import Saved, restored, saved
from minerva_services.physics.sensors import Distances, Sighting, camera, laser
from minerva_services.physics.sweep import SLACK, Point, contact, offset
from minerva_services.physics.touch import Contact, contacts
from minerva_services.physics.walls import Segments


class Arena:
    """Walls and markers, which stay, and bodies, which come, drive and go.

    Metres, seconds and degrees throughout; angles are counter-clockwise from +x. Every method that
    takes a body's name raises `PhysicsError` for one that is not here.
    """

    def __init__(self) -> None:
        self._obstacles = Obstacles()
        self._markers: dict[str, Point] = {}
        self._bodies: dict[str, Body] = {}
        self._commands: dict[str, Command] = {}
        self._seconds = 0.0

    @property
    def seconds(self) -> float:
        """Simulated time: the sum of all steps."""
        return self._seconds

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bodies' names, sorted."""
        return tuple(sorted(self._bodies))

    @property
    def markers(self) -> tuple[str, ...]:
        """The markers' names, sorted."""
        return tuple(sorted(self._markers))

    def add_walls(self, segments: Segments, *, solid_behind: bool = False) -> None:
        """Add walls without thickness that stop bodies and rays from both sides.

        Args:
            segments: (n, 4) rows `ax, ay, bx, by` in metres.
            solid_behind: they are outlines, as `wall_segments` returns them: no body may be put on
                the right of a → b, however far from the wall.

        Raises:
            PhysicsError: not (n, 4), a number that is not finite, or a wall without length.

        """
        if segments.ndim != 2 or segments.shape[1] != 4:
            raise PhysicsError(f"walls: expected rows of ax, ay, bx, by, found {segments.shape}")
        walls: list[tuple[float, float, float, float]] = [
            (ax, ay, bx, by) for ax, ay, bx, by in segments.tolist()
        ]
        for wall in walls:
            finite("walls", *wall)
            if wall[:2] == wall[2:]:
                raise PhysicsError(f"walls: one at {wall[:2]} has no length")
        for wall in walls:
            self._obstacles.add_wall(wall, solid_behind=solid_behind)

    def remove_walls(self) -> None:
        """Take all walls out."""
        self._obstacles.remove_walls()

    def add_marker(self, name: str, x: float, y: float) -> None:
        """Add something that cameras recognise; one within 1 mm of a wall's surface is seen.

        Raises:
            PhysicsError: the name is taken, or the place is not finite.

        """
        finite(f"marker {name!r}, place", x, y)
        if name in self._markers:
            raise PhysicsError(f"marker {name!r} is here already; give each marker its own name")
        self._markers[name] = (float(x), float(y))

    def remove_markers(self) -> None:
        """Take all markers out."""
        self._markers.clear()

    def add_body(self, name: str, x: float, y: float, angle: float, radius: float) -> None:
        """Put a disc of a radius in metres into free space.

        Raises:
            PhysicsError: the name is taken, a number cannot be used, or the place is not free.

        """
        finite(f"body {name!r}, pose", x, y, angle)
        positive(f"body {name!r}, radius in metres", radius)
        if name in self._bodies:
            raise PhysicsError(f"body {name!r} is here already; give each body its own name")
        body = Body(Pose(float(x), float(y), float(angle)), float(radius))
        self._refuse_solid(name, body)
        self._refuse_touching(name, body)
        self._bodies[name] = body
        self._obstacles.put_disc(name, body.centre, body.radius)

    def remove_body(self, name: str) -> None:
        """Take a body out, with a command that it has not carried out."""
        self._body(name)
        del self._bodies[name]
        self._commands.pop(name, None)
        self._obstacles.remove_disc(name)

    def pose(self, name: str) -> Pose:
        """Where a body is."""
        return self._body(name).pose

    def radius(self, name: str) -> float:
        """A body's radius in metres."""
        return self._body(name).radius

    def odometer(self, name: str) -> Odometer:
        """How far a body has driven and how often it was stopped."""
        return self._body(name).odometer

    def drive(self, name: str, turn_degrees: float, forward_m: float) -> None:
        """Command a body for the next step: turn on the spot, then drive along the new heading.

        Raises:
            PhysicsError: a number is not finite, or the body has a command for this step already.

        """
        self._body(name)
        finite(f"body {name!r}, command", turn_degrees, forward_m)
        if name in self._commands:
            raise PhysicsError(f"body {name!r} has a command for this step already; step first")
        self._commands[name] = Command(float(turn_degrees), float(forward_m))

    def turn(self, name: str, degrees: float) -> None:
        """Turn a body on the spot, at once: no command, but what the last step has done to it.

        Raises:
            PhysicsError: the turn is not finite.

        """
        finite(f"body {name!r}, turn in degrees", degrees)
        if degrees:
            self._bodies[name] = self._body(name).turned(degrees)

    def step(self, dt: float) -> tuple[Outcome, ...]:
        """Carry out all commands at the same time, each at a constant speed.

        Args:
            dt: the step's duration in seconds. Commands are distances, so it moves the clock only.

        Returns:
            One outcome for each commanded body, sorted by name. The new pose of a body is what
            `turned_deg` and then `moved_m` give by dead reckoning, to the last bit:
            `angle += turned`, `x += moved * cos(radians(angle))`, `y += moved * sin(...)`.

        Raises:
            PhysicsError: the duration is not a finite number above 0.

        """
        positive("step, duration in seconds", dt)
        commands, self._commands = self._commands, {}
        for name, command in commands.items():
            self._bodies[name] = self._bodies[name].turned(command.turn_deg)
        ends, touched = self._ends(commands)
        self._seconds += dt
        return tuple(
            self._carry_out(name, commands[name], ends[name], touched.get(name))
            for name in sorted(commands)
        )

    def scan(
        self, name: str, beams: int, first_deg: float, step_deg: float, range_max: float
    ) -> Distances:
        """Cast a planar laser from a body's centre.

        Args:
            name: the body, which its own laser does not see.
            beams: how many.
            first_deg: direction of beam 0 in degrees from the heading.
            step_deg: degrees from one beam to the next, counter-clockwise.
            range_max: in metres.

        Returns:
            (beams,) distances in metres to the nearest wall or other body; `range_max` for none.

        Raises:
            PhysicsError: fewer beams than 0, or a number that cannot be used.

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
            name: the body, which does not hide anything from its own camera.
            fov_deg: whole width of the field of view in degrees, centred on the heading; its edge
                belongs to it.
            range_max: in metres, inclusive.

        Raises:
            PhysicsError: a width or range that is not a finite number above 0.

        """
        pose = self._body(name).pose
        positive("camera, field of view in degrees", fov_deg)
        positive("camera, range in metres", range_max)
        return camera(pose, self._markers, fov_deg, range_max, self._obstacles.ray_of(name))

    def save(self) -> Saved:
        """All that changes, as plain values: not walls or markers, which belong to the world."""
        return saved(self._seconds, self._bodies, self._commands)

    def restore(self, value: Saved) -> None:
        """Replace all bodies by saved ones; what follows is bit for bit what followed there.

        Raises:
            PhysicsError: the value is not what `save` returns; the arena is as before.

        """
        seconds, bodies, commands = restored(value)
        for name in self._bodies:
            self._obstacles.remove_disc(name)
        for name, body in bodies.items():
            self._obstacles.put_disc(name, body.centre, body.radius)
        self._seconds, self._bodies, self._commands = seconds, bodies, commands

    def _body(self, name: str) -> Body:
        if name not in self._bodies:
            raise PhysicsError(f"no body {name!r} here; there are {list(self.bodies)}")
        return self._bodies[name]

    def _refuse_solid(self, name: str, body: Body) -> None:
        depth = self._obstacles.depth_in_solid(body.centre)
        overlap = depth + body.radius if depth else self._overlap_with_walls(body)
        if overlap > SLACK:
            raise PhysicsError(
                f"body {name!r} of radius {body.radius:g} m at ({body.pose.x:g}, {body.pose.y:g}) "
                f"is inside a wall; the nearest free place is at least {overlap:.3f} m away"
            )

    def _overlap_with_walls(self, body: Body) -> float:
        walls = self._obstacles.walls_near(body.centre, body.centre, body.radius)
        gaps = (portable.hypot(*offset(body.centre, wall)) for wall in walls)
        return body.radius - min(gaps, default=body.radius)

    def _refuse_touching(self, name: str, body: Body) -> None:
        for other, there in sorted(self._bodies.items()):
            overlap = body.radius + there.radius - portable.dist(body.centre, there.centre)
            if overlap > SLACK:
                raise PhysicsError(
                    f"body {name!r} at ({body.pose.x:g}, {body.pose.y:g}) overlaps body {other!r} "
                    f"by {overlap:.3f} m"
                )

    def _ends(self, commands: Mapping[str, Command]) -> tuple[dict[str, float], dict[str, Contact]]:
        """The part of its move, 0 to 1, that each body makes, and what stops it before 1."""
        forward = {name: command.forward_m for name, command in commands.items()}
        courses = {name: body.course(forward.get(name, 0)) for name, body in self._bodies.items()}
        walls = dict.fromkeys(courses, 1.0)
        driven = [name for name in commands if forward[name]]
        walls |= {name: self._end_at_walls(courses[name]) for name in driven}
        ends, stopped_by = settle(courses, walls, self._near_pairs(courses, driven))
        return ends, contacts(courses, driven, ends, stopped_by, self._obstacles.walls_near)

    def _end_at_walls(self, course: Course) -> float:
        walls = self._obstacles.walls_near(course.start, course.at(1), course.radius)
        stops = (contact(course.start, course.move, wall, course.radius) for wall in walls)
        return min(1.0, min(stops, default=1.0))

    def _near_pairs(
        self, courses: Mapping[str, Course], driven: Iterable[str]
    ) -> set[tuple[str, str]]:
        """Pairs of bodies of which one drives and that may come to touch in this step."""
        longest = max((portable.hypot(*courses[name].move) for name in driven), default=0.0)
        pairs: set[tuple[str, str]] = set()
        for name in driven:
            here = courses[name]
            margin = here.radius + longest
            for other in self._obstacles.discs_near(name, here.start, here.at(1), margin):
                pairs.add((name, other) if name < other else (other, name))
        return pairs

    def _carry_out(
        self, name: str, command: Command, end: float, touched: Contact | None
    ) -> Outcome:
        moved, collided = command.forward_m * end, end < 1
        body = self._bodies[name].driven(moved, collided=collided)
        self._bodies[name] = body
        self._obstacles.move_disc(name, body.centre)
        shortfall = abs(command.forward_m - moved)
        return Outcome(name, moved, shortfall, command.turn_deg, collided, touched)
