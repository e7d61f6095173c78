"""Rapier's space, from plain data: bodies and joints, created and removed in the order given.

Its state after a number of steps depends on the plain data and the commands alone. `Engine.kept`
has the data from which `continue_from` makes a space that continues. Contacts are found again
there, so a space that must remain equal to its successor's is made again from the same data.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from itertools import repeat
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import rapier3d
from numpy.typing import NDArray

from minerva_bodies.errors import BodiesError
from minerva_bodies.forms import AXIAL, DYNAMIC, FIXED, KINEMATIC
from minerva_bodies.meshes import Surface, check_closed, ground, load_mesh
from minerva_bodies.rigid import Rigid
from minerva_bodies.vehicle import Vehicle
from minerva_bus import portable

rapier: Any = rapier3d
"""Its stubs have unknown types, such as of handles and vectors."""

Contact: TypeAlias = tuple[str, str]

WHEEL = "wheel"
"""Form of a part that makes a body a vehicle: sizes are its radius and the suspension's travel."""
_LATE, _LOST = 0.02, 0.3
"""Metres behind its way with which a vehicle that touches something, or nothing, is stopped."""
_FACING = 0.2
"""Least cosine between the way of a vehicle and the normal of what stops it."""

_WORDS: tuple[int, ...] = (6, 7, 8, 5, 2, 3, 4, 11, 12, 13, 16, 17, 18)
"""Places of x, y, z, w, i, j, k, velocity and spin among the 32-bit words of a body's row."""
_UPRIGHT = Rigid(w=math.sqrt(0.5), i=math.sqrt(0.5))
"""Rapier's cylinders and cones lie along y, and ours stand along z."""


class Touch(NamedTuple):
    """What stops a body: the id of its agent, "" for scenery, and the direction to it."""

    other: str
    x: float
    y: float


class Engine:
    """Bodies by the ids of their agents; "" is the scenery.

    Args:
        gravity: m/s², downwards.
        dt: duration of a step, seconds.
        threads: of Rapier; they do not change its results.
        removes: whether `step` removes a body without a finite position; or else it raises.

    """

    library: Any = rapier3d

    def __init__(self, gravity: float, dt: float, threads: int, removes: bool = False) -> None:
        self._world = self.library.PhysicsWorld(gravity=(0.0, 0.0, -gravity))
        self._world.integration_parameters.dt = dt
        self._world.set_num_threads(threads)
        self._removes = removes
        self.bodies: dict[str, Any] = {}
        self.plain: dict[str, list[Any]] = {}
        """The pose at which each began, and its solids now."""
        self.lost: dict[str, None] = {}
        """Those that a step has removed, until `remove` forgets them."""
        self.vehicles: dict[str, Vehicle] = {}
        """The bodies with wheels."""
        self._names: dict[int, str] = {}
        # Of its assets: a swarm has the same one hundreds of times.
        self._surfaces: dict[tuple[str, bool], Surface] = {}
        self._followed: dict[str, tuple[Rigid, Rigid]] = {}
        self._owners: dict[Any, str] = {}
        self.joints: dict[str, tuple[Any, list[Any]]] = {}
        self.touching: dict[Contact, tuple[float, int]] = {}
        """Pairs that touch, with their impulse in the last step (N·s) and since how many frames."""

    def add(self, name: str, plain: list[Any], row: Sequence[float] = ()) -> None:
        """Create a body from its pose and solids; `row` has the state of one that continues.

        Raises BodiesError.
        """
        pose, parts = plain
        kind = _kind_of(name, parts)
        build = {
            DYNAMIC: self.library.RigidBody.dynamic,
            FIXED: self.library.RigidBody.fixed,
            KINEMATIC: self.library.RigidBody.kinematic_position_based,
        }[kind]()
        x, y, z, w, i, j, k, *speeds = row or (*pose, *[0.0] * 6, 0.0)
        build = build.position(_isometry(self.library, (x, y, z, w, i, j, k)))
        if kind == DYNAMIC:
            build = build.linvel(tuple(speeds[:3])).angvel(tuple(speeds[3:6]))
            build = build.sleeping(bool(speeds[6]))
        # All shapes first: a mesh that is none must leave no body behind.
        wheels = [part for part in parts if part[0] == WHEEL]
        solids = [self._collider(name, part) for part in parts if part[0] != WHEEL]
        # The wheels of a vehicle at rest hold it, which sleep would not let them.
        handle = self._world.add_body(build.can_sleep(False) if wheels else build)
        for solid in solids:
            self._owners[self._world.add_collider(solid, handle)] = name
        if wheels:
            ahead = Rigid(*pose).turned(1.0, 0.0, 0.0)
            angle = math.degrees(portable.atan2(ahead[1], ahead[0]))
            self.vehicles[name] = Vehicle(handle, wheels, [pose[0], pose[1], angle])
        self.bodies[name], self.plain[name] = handle, plain
        self._names[handle.index] = name

    def solids(self, name: str) -> list[Any]:
        """The solids of a body; none if there is no such body."""
        return self.plain[name][1] if name in self.plain else []

    def reshape(self, name: str, parts: list[Any]) -> None:
        """Give a body other solids where it is. Raises BodiesError."""
        if name in self.vehicles:
            raise BodiesError(f"the vehicle {name!r} cannot change its size; remove it before")
        handle = self.bodies[name]
        kind, solids = _kind_of(name, parts), [self._collider(name, part) for part in parts]
        body = self._world.rigid_bodies[handle]
        for solid in body.colliders:
            del self._owners[solid]
            self._world.remove_collider(solid)
        for solid in solids:
            self._owners[self._world.add_collider(solid, handle)] = name
        if kind != _kind_of(name, self.solids(name)):
            types = self.library.RigidBodyType
            body.body_type = {
                DYNAMIC: types.DYNAMIC,
                FIXED: types.FIXED,
                KINEMATIC: types.KINEMATIC_POSITION_BASED,
            }[kind]
        # For the commands of this frame, which precede the step.
        body.recompute_mass_properties_from_colliders(self._world.colliders)
        body.wake_up()
        self.plain[name] = [self.plain[name][0], parts]

    def remove(self, name: str) -> None:
        """Remove a body, its solids and its joints."""
        if name in self.lost:
            del self.lost[name]
            return
        for joint in [key for key, (_, plain) in self.joints.items() if name in plain[1]]:
            self.release(joint)
        handle = self.bodies.pop(name)
        self._followed.pop(name, None)
        for solid in self._world.rigid_bodies[handle].colliders:
            del self._owners[solid]
        self._world.remove_body(handle)
        self.vehicles.pop(name, None)
        del self.plain[name], self._names[handle.index]
        self.touching = {pair: n for pair, n in self.touching.items() if name not in pair}

    def join(self, name: str, plain: list[Any]) -> None:
        """Create a joint at a place between two bodies. Raises BodiesError for strangers."""
        kind, ids, place, numbers = plain
        if ids[0] == ids[1]:
            raise BodiesError(f"joint {name}: it joins {ids[0]!r} to itself; name two bodies")
        handles = [self._joined(name, who) for who in ids]
        # In the frames of the bodies where they are now.
        frames = [self._pose(handle).inverse().then(Rigid(*place)) for handle in handles]
        joint = self._world.impulse_joints.insert(
            *handles, _joint(self.library, kind, frames, numbers)
        )
        self.joints[name] = joint, [kind, ids, place, numbers, [list(f.numbers) for f in frames]]

    def rejoin(self, name: str, plain: list[Any]) -> None:
        """Create a joint again in the frames of its bodies."""
        kind, ids, _, numbers, frames = plain
        handles = [self._joined(name, who) for who in ids]
        joint = _joint(self.library, kind, [Rigid(*frame) for frame in frames], numbers)
        self.joints[name] = self._world.impulse_joints.insert(*handles, joint), plain

    def drive(self, name: str, numbers: list[float]) -> None:
        """Change limits and motor of a joint."""
        _, plain = self.joints[name]
        self.release(name)
        self.rejoin(name, [*plain[:3], numbers, plain[4]])

    def release(self, name: str) -> None:
        """Remove a joint."""
        joint, _ = self.joints.pop(name)
        self._world.impulse_joints.remove(joint)

    def positions(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Position (m, degrees from -180 to 180) and velocity of axial joints; shape (n, 2)."""
        return np.array([self._position(*self.joints[name][1]) for name in names])

    def _position(
        self, kind: str, ids: list[str], _: object, numbers: list[float], frames: list[list[float]]
    ) -> tuple[float, float]:
        along, handles = _along(kind, numbers), [self.bodies[who] for who in ids]
        first, second = [
            self._pose(handle).then(Rigid(*frame)).then(along)
            for handle, frame in zip(handles, frames, strict=True)
        ]
        left, right = [self._world.rigid_bodies[handle] for handle in handles]
        between = first.inverse().then(second)
        if kind == "prismatic":
            place = (second.x, second.y, second.z)
            slow, fast = left.velocity_at_point(place), right.velocity_at_point(place)
            position, unit = between.x, 1.0
        else:
            slow, fast = left.angvel, right.angvel
            # A rotation has two quaternions; this is the one of the smaller angle.
            sign = math.copysign(1.0, between.w)
            position = math.degrees(2.0 * portable.atan2(sign * between.i, sign * between.w))
            unit = math.degrees(1.0)
        ahead = [b - a for a, b in zip(slow.to_tuple(), fast.to_tuple(), strict=True)]
        x, y, z = first.turned(1.0, 0.0, 0.0)
        return position, unit * (x * ahead[0] + y * ahead[1] + z * ahead[2])

    def _joined(self, joint: str, who: str) -> Any:
        if who not in self.bodies:
            raise BodiesError(
                f"joint {joint}: no body of {who!r}; expected the ids of two agents with bodies in"
                ' this view, or "" for the scenery'
            )
        return self.bodies[who]

    def command(self, name: str, kind: str, x: float, y: float, z: float) -> None:
        """Give a command to a body; forces and torques act until `step` ends."""
        body, vector = self._world.rigid_bodies[self.bodies[name]], (x, y, z)
        if kind == "velocity":
            body.linvel = vector
            body.wake_up()
        elif kind == "spin":
            body.angvel = vector
            body.wake_up()
        else:
            act = {
                "force": body.add_force,
                "torque": body.add_torque,
                "impulse": body.apply_impulse,
                "twist": body.apply_torque_impulse,
            }[kind]
            act(vector)

    def follow(self, name: str, pose: Sequence[float]) -> None:
        """Move a kinematic body to a pose within the next `step`."""
        self._followed[name] = self._pose(self.bodies[name]), Rigid(*pose)

    def step(self, substeps: int, forced: Sequence[str] = ()) -> list[str]:
        """Advance by some steps; the ids of the bodies that may have moved, as they were created.

        A body that has left all numbers is lost, or raises BodiesError.
        """
        awake = self._awake()
        dt = self._world.integration_parameters.dt
        for number in range(substeps):
            for vehicle in self.vehicles.values():
                vehicle.drive(self._world, (number + 1) / substeps, dt, substeps * dt)
            for name, (begin, end) in self._followed.items():
                # A part of the way in each step, or else it would hurry and rest in turns.
                pose = begin.toward(end, (number + 1) / substeps).numbers
                body = self._world.rigid_bodies[self.bodies[name]]
                body.set_next_kinematic_position(_isometry(self.library, pose))
            self._world.step()
            lost = sorted(self._names[handle.index] for handle in self._world.quarantine.bodies)
            if lost and not self._removes:
                raise BodiesError(
                    f"the body of {lost[0]!r} has no finite position any more ({len(lost)} in all);"
                    " its forces, masses or speeds are too large for dt: use more substeps"
                )
            for name in lost:
                self.remove(name)
                self.lost[name] = None
        self._followed = {}
        for name in forced:
            if name in self.bodies:
                body = self._world.rigid_bodies[self.bodies[name]]
                body.reset_forces(False)
                body.reset_torques(False)
        # A body that has come to rest in this step has moved in it.
        moved = sorted(awake | self._awake())
        return [self._names[index] for index in moved if index in self._names]

    def _awake(self) -> set[int]:
        return {handle.index for handle in self._world.active_bodies()}

    def rows(self, names: Sequence[str]) -> NDArray[np.float64]:
        """x, y, z (m), w, i, j, k, velocity (m/s) and spin (rad/s) of bodies; shape (n, 13)."""
        bodies, handles, parts = self._world.rigid_bodies, self.bodies, list[bytes]()
        # Bytes have a fixed layout and cost a third of the tuples of each part.
        for name in names:
            body = bodies[handles[name]]
            parts += (body.position.to_bytes(), body.linvel.to_bytes(), body.angvel.to_bytes())
        words = np.frombuffer(b"".join(parts), np.float32).reshape(len(names), -1)
        return words[:, _WORDS].astype(np.float64)

    def contacts(self) -> None:
        """Read the pairs of bodies that touch, in the order of their ids; once in a frame."""
        touching = dict[Contact, float]()
        for pair in self._world.narrow_phase.contact_pairs():
            if pair.has_any_active_contact:
                left, right = self._owners[pair.collider1], self._owners[pair.collider2]
                both = (left, right) if left < right else (right, left)
                touching[both] = touching.get(both, 0.0) + pair.total_impulse_magnitude()
        for first, second, is_within in self._world.narrow_phase.intersection_pairs():
            if is_within:  # One of them is a sensor.
                left, right = sorted((self._owners[first], self._owners[second]))
                touching.setdefault((left, right), 0.0)
        # Rapier's order of pairs depends on its history.
        self.touching = {
            pair: (impulse, self.touching.get(pair, (0.0, 0))[1] + 1)
            for pair, impulse in sorted(touching.items())
        }

    def roll(self, name: str, turn: float, forward: float) -> None:
        """Command a vehicle for the next frame: a turn in degrees, then metres ahead."""
        vehicle = self.vehicles[name]
        vehicle.turn, vehicle.forward = turn, forward

    def arrive(self, name: str, after: float) -> tuple[float, Touch | None]:
        """End the command of a vehicle, with another turn by `after` degrees.

        Returns the metres along its way that it has not moved because something stopped it, and
        what it touches then.
        """
        vehicle = self.vehicles[name]
        forward = abs(vehicle.forward)
        body = self._world.rigid_bodies[vehicle.body]
        x, y, behind = vehicle.finish(body, after)
        touch = self._ahead(name, body, (x, y)) if forward and behind > _LATE else None
        if touch is None and behind <= _LOST:
            return 0.0, None
        shortfall = min(behind, forward)
        vehicle.give_way((x, y), shortfall)
        return shortfall, touch or Touch("", x, y)

    def _ahead(self, name: str, body: Any, along: tuple[float, float]) -> Touch | None:
        """What stands in the way of a body in a direction over the ground."""
        touches: list[tuple[float, Touch]] = []
        for solid in body.colliders:
            for pair in self._world.narrow_phase.contact_pairs_with(solid):
                if not pair.has_any_active_contact:
                    continue
                is_first = pair.collider1 == solid
                other = self._owners[pair.collider2 if is_first else pair.collider1]
                for manifold in pair.manifolds:
                    x, y, _ = manifold.data.normal.to_tuple()
                    x, y = (x, y) if is_first else (-x, -y)
                    facing = x * along[0] + y * along[1]
                    if manifold.data.num_active_contacts and facing > _FACING:
                        length = math.sqrt(x * x + y * y)
                        touches.append((facing, Touch(other, x / length, y / length)))
        # Rapier's order of pairs depends on its history.
        return max(touches)[1] if touches else None

    def pose(self, name: str) -> Rigid:
        """The pose of a body now."""
        return self._pose(self.bodies[name])

    def cast(
        self, start: Sequence[float], along: NDArray[np.float64], longest: float, name: str = ""
    ) -> NDArray[np.float64]:
        """Metres to what rays meet first, `longest` for nothing; shape (n,).

        Sensors and the body `name` are invisible; shapes that a ray begins in are met at once.

        Args:
            start: point where all rays begin.
            along: directions of length 1, shape (n, 3).
            longest: of all rays, metres.
            name: of a body, or "".

        """
        cast, seen = self._world.query_pipeline.cast_ray, self._all_but(name)
        rays = map(rapier.Ray, repeat(tuple(start)), zip(*along.T.tolist(), strict=True))
        hits = [cast(ray, longest, True, seen) for ray in rays]
        return np.array([longest if hit is None else hit[1] for hit in hits])

    def _all_but(self, name: str) -> Any:
        """A filter of solids that are neither sensors nor part of a body."""
        own = self.bodies[name] if name else None
        return rapier.QueryFilter(exclude_rigid_body=own).exclude_sensors()

    def echoes(
        self,
        start: Sequence[float],
        along: NDArray[np.float64],
        longest: float,
        name: str,
        lit: bool,
    ) -> tuple[NDArray[np.float64], tuple[float, ...]]:
        """As `cast`; if `lit`, also the cosines at which rays meet surfaces, 0 for nothing."""
        if not lit:
            return self.cast(start, along, longest, name), ()
        cast, seen = self._world.query_pipeline.cast_ray_and_get_normal, self._all_but(name)
        ranges, cosines = list[float](), list[float]()
        for x, y, z in along.tolist():
            hit = cast(rapier.Ray(tuple(start), (x, y, z)), longest, True, seen)
            nx, ny, nz = (0.0, 0.0, 0.0) if hit is None else hit[1].normal.to_tuple()
            ranges.append(longest if hit is None else hit[1].time_of_impact)
            cosines.append(abs(x * nx + y * ny + z * nz))
        return np.array(ranges), tuple(cosines)

    def velocity(self, name: str, mount: Rigid) -> tuple[float, float, float]:
        """Velocity of a point of a body, m/s in the frame of the world."""
        at = self.pose(name).then(mount)
        body = self._world.rigid_bodies[self.bodies[name]]
        x, y, z = body.velocity_at_point((at.x, at.y, at.z)).to_tuple()
        return x, y, z

    def spin(self, name: str) -> tuple[float, float, float]:
        """Angular velocity of a body, rad/s in the frame of the world."""
        x, y, z = self._world.rigid_bodies[self.bodies[name]].angvel.to_tuple()
        return x, y, z

    def kept(self) -> Mapping[str, Any]:
        """Bodies and joints as plain data, from which `continue_from` makes this space again."""
        names = list(self.bodies)
        bodies = [self._world.rigid_bodies[self.bodies[name]] for name in names]
        asleep = np.array([body.is_sleeping for body in bodies], np.float64)
        rows = np.column_stack((self.rows(names), asleep)) if names else np.zeros((0, 14))
        return {
            "bodies": json.dumps([[name, self.plain[name]] for name in names]),
            "lost": json.dumps(list(self.lost)),
            "rows": rows.astype("<f8").tobytes(),
            "joints": json.dumps([[name, plain] for name, (_, plain) in self.joints.items()]),
            "vehicles": json.dumps({name: each.goal for name, each in self.vehicles.items()}),
            "touching": json.dumps([[*pair, *n] for pair, n in self.touching.items()]),
        }

    def continue_from(self, kept: Mapping[str, Any]) -> None:
        """Fill a new space from `kept`. Raises BodiesError for other data."""
        try:
            rows = np.frombuffer(kept["rows"], "<f8").reshape(-1, 14).tolist()
            for (name, plain), row in zip(json.loads(kept["bodies"]), rows, strict=True):
                self.add(name, plain, row)
            for name, plain in json.loads(kept["joints"]):
                self.rejoin(name, plain)
            for name, goal in json.loads(kept["vehicles"]).items():
                self.vehicles[name].goal = goal
            self.lost = dict.fromkeys(json.loads(kept["lost"]))
            touching = json.loads(kept["touching"])
            self.touching = {(a, b): (float(n), int(frames)) for a, b, n, frames in touching}
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, BodiesError):
                raise
            raise BodiesError(f"not the saved state of a space of bodies: {error!r}") from error

    def _pose(self, handle: Any) -> Rigid:
        at = self._world.rigid_bodies[handle].position
        i, j, k, w = at.rotation.to_tuple()
        x, y, z = at.translation.to_tuple()
        return Rigid.quaternion(x, y, z, w, i, j, k)

    def _collider(self, name: str, part: list[Any]) -> Any:
        form, (density, friction, restitution, _, sensor, group), sizes, pose = part
        at = Rigid(*pose)
        if form in ("cylinder", "cone"):
            at = at.then(_UPRIGHT)
        try:
            built = self._shape(name, form, sizes, part[1][3])
        except BaseException as error:
            # Rapier panics for shapes without volume, which Python sees as no Exception.
            if isinstance(error, BodiesError | KeyboardInterrupt | SystemExit):
                raise
            raise BodiesError(f"agent {name!r}: {form} {sizes!r:.60}: {error}") from None
        types = self.library.ActiveCollisionTypes
        return (
            built.density(density)
            .friction(friction)
            .restitution(restitution)
            .sensor(bool(sensor))
            .active_collision_types(types.all() if sensor else types.default_types())
            .collision_groups(_groups(self.library, int(group)))
            .position(_isometry(self.library, at.numbers))
        )

    def _shape(self, name: str, form: str, sizes: list[Any], moved: float) -> Any:
        if form == "terrain":
            return self.library.Collider.trimesh(*ground(*sizes))
        if form != "mesh":
            return {
                "box": self.library.Collider.cuboid,
                "ball": self.library.Collider.ball,
                "capsule": self.library.Collider.capsule_z,
                "cylinder": self.library.Collider.cylinder,
                "cone": self.library.Collider.cone,
            }[form](*sizes)
        closed = bool(name) and moved == DYNAMIC
        points, triangles = self._surface(sizes[0], closed)
        if closed:
            return self.library.Collider.convex_hull(points * sizes[1])
        return self.library.Collider.trimesh(points * sizes[1], triangles)

    def _surface(self, file: str, closed: bool) -> Surface:
        if (file, closed) not in self._surfaces:
            surface = load_mesh(file)
            if closed:
                check_closed(file, surface)
            self._surfaces[file, closed] = surface
        return self._surfaces[file, closed]


def _kind_of(name: str, parts: list[Any]) -> float:
    kinds = {part[1][3] for part in parts}
    if not name:
        return FIXED
    if len(kinds) > 1:
        raise BodiesError(f"the solids of {name!r} are moved in different ways; make them alike")
    return float(kinds.pop())


def _isometry(rapier: Any, numbers: Sequence[float]) -> Any:
    x, y, z, w, i, j, k = numbers
    return rapier.Isometry3((x, y, z), rapier.Rotation3(w, i, j, k))


def _groups(rapier: Any, group: int) -> Any:
    """Solids of a group meet all but each other; those of group -1 meet nothing."""
    if not group:
        return rapier.InteractionGroups.all()
    own = 1 << group if group > 0 else 0
    return rapier.InteractionGroups(
        rapier.Group.from_bits(own), rapier.Group.from_bits(0xFFFFFFFF ^ own if own else 0)
    )


def _along(kind: str, numbers: list[float]) -> Rigid:
    """The shortest rotation from the x axis to the axis of a joint. Raises BodiesError."""
    x, y, z = numbers[:3]
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 0.0:
        raise BodiesError(f"{kind} joint: its axis has no length; expected a vector")
    x, y, z = x / length, y / length, z / length
    # None is shortest to its opposite.
    return Rigid.quaternion(0, 0, 0, *((1 + x, 0, -z, y) if x > -1 else (0, 0, 1, 0)))


def _joint(rapier: Any, kind: str, frames: Sequence[Rigid], numbers: list[float]) -> Any:
    """A joint in the frames of two bodies, whose x axes become the joint's axis."""
    low, high, target, stiffness, speed, damping = numbers[3:]
    along = _along(kind, numbers)
    masks, axes = rapier.JointAxesMask, rapier.JointAxis
    locked = {
        "fixed": masks.LOCKED_FIXED_AXES,
        "revolute": masks.LOCKED_REVOLUTE_AXES,
        "prismatic": masks.LOCKED_PRISMATIC_AXES,
        "spherical": masks.LOCKED_SPHERICAL_AXES,
    }[kind]
    left, right = [_isometry(rapier, frame.then(along).numbers) for frame in frames]
    built = rapier.GenericJointBuilder(locked).local_frame1(left).local_frame2(right)
    unit = 1.0 if kind == "prismatic" else math.pi / 180
    free = {
        "fixed": [],
        "revolute": [axes.ANG_X],
        "prismatic": [axes.LIN_X],
        "spherical": [axes.ANG_X, axes.ANG_Y, axes.ANG_Z],
    }[kind]
    if low < high:
        for axis in free:
            built = built.limits(axis, low * unit, high * unit)
    if kind in AXIAL and (stiffness > 0.0 or damping > 0.0):
        built = built.motor(free[0], target * unit, speed * unit, stiffness, damping)
        built = built.motor_model(free[0], rapier.MotorModel.FORCE_BASED)
    return built.contacts_enabled(False).build()
