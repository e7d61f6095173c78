"""The service `rovers`: the string of robots in the plane, as solids in space.

The alphabet is that of the service `physics`, and other solids and joints may stand beside it:

PMap           its occupied and unknown cells, extruded to the height of its form, on a floor
PMarker        a marker at its position, at the height of the sensors
PRobot         a vehicle of its radius and the height of its form, at the innermost motion around
               it that is no command
TRotate, TMove a command for the vehicle within
"""

from __future__ import annotations

import json
import math
from collections.abc import Generator as Yields
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from minerva_bodies.bounds import BoundingBox, BoundsGeometry, core_of
from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import DYNAMIC, FIXED
from minerva_bodies.geometry import Part, ShownBody, SpaceGeometry
from minerva_bodies.rigid import Rigid
from minerva_bodies.service import RigidBodies
from minerva_bus import portable
from minerva_bus.grammar.events import AnyEvent
from minerva_bus.grammar.scene import FigureNode, TransformationNode
from minerva_bus.grammar.vocabulary import Vocabulary
from minerva_bus.semantics.poses import Pose
from minerva_bus.world.readings import Odometry, Scan, Sightings
from minerva_bus.world.services import Tick, View, WorldInfo
from minerva_services.options import takes_options
from minerva_services.physics.body import DriveCommand, DriveOutcome
from minerva_services.physics.encounters import Contact, Point
from minerva_services.physics.sensors import camera
from minerva_services.physics.service import Physics, PhysicsOptions

_FLOOR: Final = 0.5
"""Thickness of the floor and of the walls around a map, metres."""
_SOLID: Final = [0.0, 0.5, 0.0, FIXED, 0.0, 0.0]
_BALLAST, _HULL = [1500.0, 0.1, 0.0, DYNAMIC, 0.0, 0.0], [100.0, 0.1, 0.0, DYNAMIC, 0.0, 0.0]
"""Materials of a robot's lower third, whose weight keeps it upright, and of the rest."""


class RobotGeometry(SpaceGeometry):
    """Contents of one view: solids and joints, and the robots, markers and maps of the plane.

    Attributes:
        commands: of the robots, by name, in the order of the string.
        markers: positions by name, metres.
        radii: of the robots, metres.

    """

    _walls: tuple[Any, NDArray[np.int16], list[Part]] | None = None
    """The last map and its solids: most views have the same."""

    def _clear(self) -> None:
        super()._clear()
        self.commands: dict[str, DriveCommand] = {}
        self.markers: dict[str, Point] = {}
        self._command = DriveCommand()
        self._placed: Rigid | None = None

    def other_figure(self, figure: FigureNode) -> None:
        given = figure.parameters
        if figure.symbol == "PMap":
            self._map(figure, **given)
        elif figure.symbol == "PRobot":
            self._robot(figure, **given)
        elif figure.symbol == "PMarker":
            if given["name"] in self.markers:
                raise BodiesError(
                    f"marker {given['name']!r} appears twice in the view; make the names unique"
                )
            self.markers[given["name"]] = self.pose.x, self.pose.y
        else:
            super().other_figure(figure)

    def _map(
        self, figure: FigureNode, cells: Any, resolution: float, x: float, y: float, angle: float
    ) -> None:
        """α: a floor, walls around it, and a box for each rectangle of solid cells."""
        if not 0.0 < resolution < 1e6:
            raise BodiesError(f"{figure.symbol}: cells of {resolution} m; expected metres above 0")
        corner = self.pose.then(Rigid.euler(x, y, 0.0, angle))
        key = (resolution, self._height(figure), corner)
        last = RobotGeometry._walls
        # Comparing the matrix takes longer than looking whether it is the same object.
        is_same = last is not None and (last[1] is cells or np.array_equal(last[1], cells))
        if last is None or last[0] != key or not is_same:
            last = RobotGeometry._walls = key, cells, map_parts(cells, *key)
        self.bodies.setdefault("", ShownBody(Rigid())).parts.extend(last[2])
        self.seen[""] += len(last[2])

    def _stand(self, base: Rigid, at: Rigid, *solid: Any) -> None:
        """α of a solid at a pose in the body at `base`."""
        outside = self.pose, self._base, self._inner, self._commands
        self.pose, self._base, self._inner, self._commands = base.then(at), base, at, ()
        self.solid(*solid)
        self.pose, self._base, self._inner, self._commands = outside

    def _robot(self, figure: FigureNode, name: str, radius: float) -> None:
        """α: a vehicle and its command."""
        if not name or "\n" in name or "\t" in name:
            raise BodiesError(f"a robot is called {name!r}; give it the id of its agent")
        if name in self.commands:
            raise BodiesError(f"robot {name!r} appears twice in the view; make the names unique")
        if not 0.0 < radius < 1e6:
            raise BodiesError(f"robot {name!r}: its radius is {radius}; expected metres above 0")
        self.commands[name] = self._command
        base = self._placed or self.pose
        for form, material, sizes, pose in vehicle_parts(radius, self._height(figure)):
            self._stand(base, Rigid(*pose), form, name, figure, [*material, *sizes])

    def _height(self, figure: FigureNode) -> float:
        shape = self._vocabulary.primitives[figure.symbol].shape
        return float(getattr(shape, "height", 0.0) or 0.5)

    def other_transformation(
        self, transformation: TransformationNode
    ) -> AbstractContextManager[Any]:
        if transformation.symbol in ("TRotate", "TMove"):
            return self._driving(transformation)
        return self._placing(transformation)

    @contextmanager
    def _placing(self, node: TransformationNode) -> Yields[None]:
        outside = self._command, self._placed
        self._command, self._placed = DriveCommand(), None
        with self._within(node):
            yield
        self._command, self._placed = outside

    @contextmanager
    def _driving(self, node: TransformationNode) -> Yields[None]:
        """β: add to the command; δ: restore it."""
        outside = self._command, self._placed
        self._placed = self._placed or self.pose
        turn, forward = self._command.turn_deg, self._command.forward_m
        (value,) = node.parameters.values()
        if node.symbol == "TMove":
            forward += value
        elif value and forward:
            raise BodiesError(
                f"TRotate<angle={value:g}> within TMove<dist={forward:g}>: in one frame a robot"
                " first turns, then drives; put TMove within TRotate"
            )
        else:
            turn += value
        self._command = DriveCommand(turn, forward)
        with self._within(node):
            yield
        self._command, self._placed = outside


class _RobotBounds(BoundsGeometry, RobotGeometry):
    """φ of robots, with the boxes of hulls, floors and walls; wheels are rays."""

    def solid(self, form: str, owner: str, figure: FigureNode, values: list[Any]) -> None:
        if form == "wheel":
            RobotGeometry.solid(self, form, owner, figure, values)
        else:
            super().solid(form, owner, figure, values)

    def _map(self, figure: FigureNode, *place: Any, **given: Any) -> None:
        before = self.seen[""]
        super()._map(figure, *place, **given)
        for form, _, sizes, pose in self.bodies[""].parts[before:]:
            self.bound("", figure.symbol, core_of(form, sizes, False), Rigid(*pose))


def robot_boxes(view: View, vocabulary: Vocabulary, who: str = "who") -> list[BoundingBox]:
    """The bounding boxes of a view with robots and maps of the plane, as `rovers` has them.

    Those of a robot are the two parts of its hull. See `bounds.bounding_boxes`.
    """
    geometry = _RobotBounds(vocabulary, who=who)
    geometry.read(view)
    return geometry.boxes


def blocks(cells: NDArray[np.int16]) -> list[tuple[int, int, int, int]]:
    """Rectangles that fill the cells other than 0: first and end of rows, then of columns."""
    done = list[tuple[int, int, int, int]]()
    begun = dict[tuple[int, int], int]()
    edges = np.diff(np.pad(cells != 0, ((0, 1), (1, 1))).astype(np.int8), axis=1)
    for number, line in enumerate(edges):
        first, end = np.flatnonzero(line > 0).tolist(), np.flatnonzero(line < 0).tolist()
        runs = dict.fromkeys(zip(first, end, strict=True))
        for run in [run for run in begun if run not in runs]:
            done.append((begun.pop(run), number, *run))
        for run in runs:
            begun.setdefault(run, number)
    return done


def map_parts(
    cells: NDArray[np.int16], resolution: float, height: float, corner: Rigid
) -> list[Part]:
    """A floor, walls around it, and a box of a height for each rectangle of solid cells."""
    rows, columns = cells.shape
    edge, half = _FLOOR / resolution, resolution / 2.0
    around = [
        (-edge, 0, -edge, columns + edge),
        (rows, rows + edge, -edge, columns + edge),
        (0, rows, -edge, 0),
        (0, rows, columns, columns + edge),
    ]
    parts = list[Part]()
    for (row, end, column, ends), low, high in (
        ((0, rows, 0, columns), -_FLOOR, 0.0),
        *[(block, 0.0, height) for block in (*around, *blocks(cells))],
    ):
        sizes = [(end - row) * half, (ends - column) * half, (high - low) / 2.0]
        middle = Rigid((end + row) * half, (ends + column) * half, (high + low) / 2.0)
        parts.append(["box", _SOLID, sizes, list(corner.then(middle).numbers)])
    return parts


def vehicle_parts(radius: float, height: float) -> list[Part]:
    """A robot as solids and wheels; its origin is on the ground, and x points ahead."""
    wheel, travel, arm = 0.3 * radius, 0.3 * radius, 0.65 * radius
    low = min(0.25 * radius, height / 4.0)
    middle = low + (height - low) / 3.0
    parts: list[Part] = [
        [
            "cylinder",
            material,
            [(end - begin) / 2.0, radius],
            [0, 0, (begin + end) / 2.0, 1, 0, 0, 0],
        ]
        for material, begin, end in ((_BALLAST, low, middle), (_HULL, middle, height))
    ]
    for x, y in ((arm, arm), (arm, -arm), (-arm, arm), (-arm, -arm)):
        parts.append(["wheel", _HULL, [wheel, travel], [x, y, wheel, 1, 0, 0, 0]])
    return parts


class _Space(RigidBodies):
    """The bodies, and what the robots measure among them."""

    def show(self, view: View) -> None:
        self.is_new = view.frame > self._shown
        self.seen = RobotGeometry(self._vocabulary, self._engine.plain, self._who)
        self.seen.read(view)
        self._take(view, self.seen)

    def advance(self, rolls: list[list[Any]], tick: Tick) -> list[AnyEvent]:
        """A frame with commands: name, turn, metres ahead, and a turn afterwards."""
        if rolls:
            self._next["roll"] = rolls
        return list(self.generate(tick))

    def send(self, scans: Iterable[Scan], height: float) -> None:
        """Send scans to the network of ROS 2, if there is one."""
        if self._node is not None:
            self._node.publish_scans(scans, height)

    @property
    def arrivals(self) -> Mapping[str, tuple[float, Any]]:
        """The shortfall of each robot with a command, and what stopped it."""
        return self._arrivals

    def pose(self, name: str) -> Rigid:
        """The pose of a robot."""
        return self._engine.pose(name)

    def radius(self, name: str) -> float:
        """Of a robot, metres."""
        return float(self._engine.solids(name)[0][2][1])

    def cast(
        self, name: str, along: NDArray[np.float64], longest: float, height: float
    ) -> NDArray[np.float64]:
        """Metres that rays from a robot go, in directions of its axes; see `Engine.cast`."""
        pose = self._engine.pose(name)
        start = pose.then(Rigid(z=height))
        turned = np.column_stack(pose.turned(*along.T))
        return self._engine.cast((start.x, start.y, start.z), turned, longest, name)

    def free(self, name: str, height: float, start: Point, end: Point) -> float:
        """The free part of a level line between two points of the plane."""
        way = portable.dist(start, end)
        if not way:
            return 1.0
        along = np.array([[(end[0] - start[0]) / way, (end[1] - start[1]) / way, 0.0]])
        z = self._engine.pose(name).z + height
        return float(self._engine.cast((*start, z), along, way, name)[0] / way)


class Rovers(Physics):
    """Executes the commands of each view in the following tick, and then measures.

    Robots are vehicles among the walls of maps and the solids and joints of the string, with the
    commands, readings and events of the service `physics`; `bodies` describes what moves solids.
    A vehicle follows its commands with small deviations, which its motors correct; one that is
    stopped gets `eCollision`. Further options are `PhysicsOptions`.

    Args:
        height: of the sensors above the ground, metres; their plane tilts with the robot.
        gravity: m/s², downwards.
        substeps: steps of physics in a frame.
        threads: of physics; results do not depend on them.
        renew: frames after which the space is made again from its saved state.
        draws: the visual event type of the views.
        pose: the event type of poses of other bodies; "" for none.
        contact: the event type of contacts; "" for none.
        ros2: the options of `Ros2Network`, to send poses and scans to a network of ROS 2, too.
        poses: topic of `Odometry` with the poses of robots as they are; "" for none.

    """

    by_agent = False

    @takes_options(PhysicsOptions)
    def __init__(
        self,
        height: float = 0.25,
        gravity: float = 9.81,
        substeps: int = 20,
        threads: int = 1,
        renew: int = 300,
        draws: str = "eRepresent",
        pose: str = "",
        contact: str = "",
        ros2: Mapping[str, Any] | None = None,
        poses: str = "",
        **options: Any,
    ) -> None:
        if not 0.0 < height < 1e3:
            raise BodiesError(f"rovers: height is {height}; expected metres above 0, as 0.25")
        self._space = _Space(
            gravity,
            draws,
            pose,
            contact,
            substeps=substeps,
            threads=threads,
            renew=renew,
            ros2=ros2,
        )
        self._height = height
        super().__init__(**options)
        self.draws, self._poses = (draws,), poses
        if poses:
            self.publishes = (*self.publishes, poses)
        angles = np.radians(self._first + self._step * np.arange(self._beams))
        cos, sin = portable.cos_sin(angles)
        self._beam_axes = np.column_stack((cos, sin, np.zeros(self._beams)))
        self._driven_um = self._collisions = 0

    def generates(self) -> tuple[str, ...]:
        return ("eCollision", *self._space.generates())

    def check(self, world: WorldInfo) -> None:
        super().check(world)
        self._space.check(world)

    def joined(self, world: WorldInfo) -> None:
        super().joined(world)
        self._space.joined(world)

    def show(self, view: View) -> None:
        """φ of the view: what is new, gone and commanded, for the next tick."""
        self._space.show(view)
        seen, self._shown = self._space.seen, view.frame
        self._seen, self._markers = tuple(seen.commands), dict(sorted(seen.markers.items()))
        # A successor receives the last view again, which its predecessor has executed.
        commands = seen.commands if self._space.is_new else {}
        self._commands = {name: it for name, it in commands.items() if name not in view.halted}

    def generate(self, tick: Tick) -> Iterable[Any]:
        """Drive, then measure; nothing before the first view."""
        self._others = list[AnyEvent]()
        events = [*super().generate(tick), *self._others]
        scans = [reading for _, reading in tick.published if isinstance(reading, Scan)]
        self._space.send(scans, self._height)
        if self._poses and self._shown is not None:
            for name in self._seen:
                at = self._pose(name)
                pose = Odometry(name, at.x, at.y, at.angle, 0.0, 0.0, tick.time)
                tick.publish(self._poses, pose)
        return events

    def _drive(self, tick: Tick) -> Mapping[str, DriveOutcome]:
        rolls = list[list[Any]]()
        for name, command in sorted(self._commands.items()):
            step = self._errors.drive(name, command.turn_deg, command.forward_m, tick)
            rolls.append([name, step.turn_deg, step.forward_m, step.after_deg])
        self._others = self._space.advance(rolls, tick)
        return {name: self._outcome(name, turn, forward) for name, turn, forward, _ in rolls}

    def _outcome(self, name: str, turn: float, forward: float) -> DriveOutcome:
        shortfall, touch = self._space.arrivals[name]
        moved = math.copysign(abs(forward) - shortfall, forward)
        self._driven_um += round(abs(moved) * 1e6)
        if touch is None:
            return DriveOutcome(name, moved, 0.0, turn, False)
        self._collisions += 1
        at, reach = self._space.pose(name), self._space.radius(name)
        contact = Contact(
            touch.other, at.x + reach * touch.x, at.y + reach * touch.y, -touch.x, -touch.y
        )
        return DriveOutcome(name, moved, shortfall, turn, True, contact)

    def _scan(self, name: str, tick: Tick) -> Scan:
        reach = self._range_max
        distances = self._space.cast(name, self._beam_axes, reach, self._height)
        ranges = self._errors.scan(name, distances, reach, tick).astype(np.float32)
        return Scan(name, ranges, self._first, self._step, reach, tick.time)

    def _sightings(self, name: str, tick: Tick) -> Sightings:
        pose = self._pose(name)
        ray = partial(self._space.free, name, self._height)
        visible = camera(pose, self._markers, self._camera_fov, self._camera_range, ray)
        measured = self._errors.recognised(name, visible, tuple(self._markers), tick)
        return Sightings(name, measured, tick.time)

    def _pose(self, name: str) -> Pose:
        at = self._space.pose(name)
        ahead = at.turned(1.0, 0.0, 0.0)
        return Pose(at.x, at.y, math.degrees(portable.atan2(ahead[1], ahead[0])))

    def save(self) -> Mapping[str, Any]:
        """The space some frames ago and what happened since, and totals."""
        totals = {"driven_um": self._driven_um, "collisions": self._collisions}
        return {**self._space.save(), **totals, "stopped": json.dumps(self._stopped)}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Continue from a saved state. Raises BodiesError for other data."""
        self._space.restore(saved)
        try:
            self._driven_um, self._collisions = int(saved["driven_um"]), int(saved["collisions"])
            self._stopped = dict(json.loads(saved["stopped"]))
        except (KeyError, TypeError, ValueError) as error:
            raise BodiesError(f"not the saved state of robots in space: {error!r}") from error

    def report(self) -> Mapping[str, bool | int | float | str]:
        """Distance driven and stopped moves over all robots, and those of `bodies`."""
        driven = {"distance_driven": self._driven_um / 1e6, "collisions": self._collisions}
        return driven | dict(self._space.report())

    def close(self) -> None:
        """Leave the network of ROS 2."""
        self._space.close()
