"""A swarm of quadrotors: their agents evolve to the thrusts of four rotors each.

Physics shows an agent the pose and the speeds of its body. The agent compares them with its
reference, which moves to its place in the formation, and shows the force and the torque of its
rotors. It asks for each step of the reference by an event, which a norm may reject; it then tries
another direction. Methods take the whole swarm at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from minerva_bodies import Box, Command, Cylinder, Matter, Mesh, euler, quaternion
from minerva_bus import (
    EMPTY,
    Agent,
    BatchContext,
    Context,
    Default,
    Event,
    EventType,
    Metres,
    Primitive,
    Scene,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)

Floats: TypeAlias = NDArray[Any]

DT, GRAVITY = 0.02, 9.81  # seconds of a frame, m/s²
MASS, INERTIA = 0.75, (0.0151, 0.0156, 0.0303)  # kg, kg·m²
ARM, DRAG = 0.17, 0.05  # of a rotor along x and y, metres; its torque per thrust, metres
ROTORS = ((1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1))  # signs of x, y and torque about z
STRONGEST, STEEPEST = 5.0, 6.0  # thrust of a rotor, N; acceleration sideways, m/s²
PLACE, SPEED = 9.0, 5.4  # gains of the position, 1/s² and 1/s
TILT, SPIN = 100.0, 18.0  # gains of the attitude, 1/s² and 1/s
FASTEST, APART = 2.5, 1.3  # m/s; neighbours in a formation, metres
CLEAR, AVOID = 1.0, 12.0  # metres to another one, and the acceleration at 0 m, m/s²
ASIDE, BACK = 20.0, 2.0  # degrees of a detour for a refusal, and back in a frame
LOOK = 1.5  # how far ahead a quadrotor asks whether it may go, metres
SMOOTH = 0.1  # share of a step in the mean speed of the reference
LOW = 2.0  # height of a formation above ground, metres

# --- the vocabulary -------------------------------------------------------------------------------

HULL = Matter(density=54.9, friction=0.4)
GROUND = Matter(friction=0.8, fixed=True)
PLACED: dict[str, Any] = {**dict.fromkeys("xyz", Metres), **dict.fromkeys("wijk", float)}
POINT: dict[str, Any] = dict.fromkeys("xyz", Metres)
SPEEDS: dict[str, Any] = dict.fromkeys(("vx", "vy", "vz", "wx", "wy", "wz"), float)
VECTOR: dict[str, Any] = dict.fromkeys("xyz", float)
FILE = Default(str, "minerva_bodies/swarm/quad.obj")

PQuad = Primitive(
    "PQuad",
    Mesh("file", 1.0, "#1f4e79", radius=0.3, matter=HULL, meaning="quadrotor"),
    who=str,
    file=FILE,
)
PSpot = Primitive("PSpot", who=str)
PField = Primitive("PField", Box(23.0, 10.0, 0.5, "#c9d3b8", matter=GROUND))
PZone = Primitive("PZone", Cylinder(0.01, 3.0, "#e3a79a", matter=GROUND, meaning="forbidden"))
PTower = Primitive("PTower", Cylinder(6.0, 1.0, "#8a8578", matter=GROUND, meaning="tower"))
TAt = Transformation("TAt", euler("x", "y", "z"), **POINT)
TPose = Transformation("TPose", quaternion("x", "y", "z", "w", "i", "j", "k"), **PLACED)
TForce = Transformation("TForce", Command("force", "x", "y", "z"), **VECTOR)
TTorque = Transformation("TTorque", Command("torque", "x", "y", "z"), **VECTOR)

eStep = EventType("eStep")
ePose = EventType("ePose", **PLACED, **SPEEDS)
eNext = EventType("eNext")
eFormation = EventType(
    "eFormation", shape=Literal["sphere", "rings", "cube", "wave"], x=Metres, y=Metres
)
eSlot = EventType("eSlot", **POINT, pace=float, side=float)
eWaypoint = EventType("eWaypoint", **POINT)
eDetour = EventType("eDetour")
eNear = EventType("eNear", dx=Metres, dy=Metres, z=Metres)
eWhere = EventType("eWhere", visual=True)
# For physics in each frame, and for people as often as they look.
eBodies = EventType("eBodies", visual=True)
ePicture = EventType("ePicture", visual=True)

# --- quadrotors -----------------------------------------------------------------------------------


class Quad(Agent, symbol="AQuad"):
    """A quadrotor: its pose and speeds, its reference, its place in the formation, its thrusts."""

    x: Metres
    y: Metres
    z: Metres
    w: float = 1.0
    i: float = 0.0
    j: float = 0.0
    k: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    vz: float = 0.0
    wx: float = 0.0
    wy: float = 0.0
    wz: float = 0.0
    # The reference and its speed; where it goes, how fast, and the turn of a detour.
    gx: Metres
    gy: Metres
    gz: Metres
    hx: float = 0.0
    hy: float = 0.0
    hz: float = 0.0
    sx: Metres
    sy: Metres
    sz: Metres
    pace: float = 0.0
    side: float = 1.0
    turn: float = 0.0
    # The acceleration away from others.
    ex: float = 0.0
    ey: float = 0.0
    ez: float = 0.0
    # Newtons: front left, rear left, rear right, front right.
    f1: float = 0.0
    f2: float = 0.0
    f3: float = 0.0
    f4: float = 0.0

    @on("eNear", population=True, together=True)
    def avoid(self, near: Event, moment: BatchContext) -> None:
        """Keep clear of others that are near, also in height."""
        me: Any = self
        away = near.dx, near.dy, near.z - me.z[near.row]
        distance = np.sqrt(dot(away, away))
        push = -AVOID * np.maximum(0.0, 1.0 - distance / CLEAR) / np.maximum(distance, 0.01)
        me.ex, me.ey, me.ez = [np.bincount(near.row, push * part, len(me)) for part in away]

    @on("ePose", population=True)
    def sense(self, pose: Event, moment: BatchContext) -> None:
        self.x, self.y, self.z = pose.x, pose.y, pose.z
        self.w, self.i, self.j, self.k = pose.w, pose.i, pose.j, pose.k
        self.vx, self.vy, self.vz = pose.vx, pose.vy, pose.vz
        self.wx, self.wy, self.wz = pose.wx, pose.wy, pose.wz

    @on("eSlot", population=True)
    def join(self, slot: Event, moment: BatchContext) -> None:
        self.sx, self.sy, self.sz = slot.x, slot.y, slot.z
        self.pace, self.side, self.turn = slot.pace, slot.side, 0.0

    @on("eWaypoint", population=True)
    def go(self, point: Event, moment: BatchContext) -> None:
        """The point is permitted: move the reference towards it."""
        way = point.x - self.gx, point.y - self.gy, point.z - self.gz
        speed = np.minimum(self.pace / np.sqrt(dot(way, way)), 1.0 / DT)
        vx, vy, vz = [speed * part for part in way]
        self.gx, self.gy, self.gz = self.gx + DT * vx, self.gy + DT * vy, self.gz + DT * vz
        self.hx, self.hy, self.hz = [
            before + SMOOTH * now for before, now in ((self.hx, vx), (self.hy, vy), (self.hz, vz))
        ]
        self.turn = self.side * np.maximum(0.0, np.abs(self.turn) - BACK)

    @on("eDetour", population=True)
    def give_way(self, detour: Event, moment: BatchContext) -> None:
        """The point is forbidden: try another one, further aside."""
        self.turn = self.side * np.minimum(180.0, np.abs(self.turn) + ASIDE)

    @on("eStep", population=True)
    def fly(self, step: Event, moment: BatchContext) -> None:
        """Ask for a point on the way to the place, and control the rotors."""
        dx, dy, dz = self.sx - self.gx, self.sy - self.gy, self.sz - self.gz
        way = np.sqrt(dx * dx + dy * dy + dz * dz)
        share = np.minimum(1.0, LOOK / np.maximum(way, 1e-9))
        angle = cast("NDArray[np.float64]", np.radians(self.turn))
        cos, sin = portable.cos(angle), portable.sin(angle)
        point = eWaypoint(
            self.gx + share * (cos * dx - sin * dy),
            self.gy + share * (sin * dx + cos * dy),
            self.gz + share * dz,
            receivers=self.id,
        )
        moment.emit(point, where=way > 1e-6)
        self.control()
        self.ex = self.ey = self.ez = 0.0
        # The mean of the steps, most of the last ones: a forbidden step adds nothing.
        self.hx, self.hy, self.hz = [(1 - SMOOTH) * part for part in (self.hx, self.hy, self.hz)]

    def control(self) -> None:
        """Thrusts that accelerate the body to its reference, and turn it to where they point."""
        ahead, left, up = axes(self.w, self.i, self.j, self.k)
        ax, ay, az = [
            PLACE * (goal - place) + SPEED * (wanted - speed) + away
            for goal, place, wanted, speed, away in (
                (self.gx, self.x, self.hx, self.vx, self.ex),
                (self.gy, self.y, self.hy, self.vy, self.ey),
                (self.gz, self.z, self.hz, self.vz, self.ez),
            )
        ]
        aside = np.minimum(1.0, STEEPEST / np.maximum(np.sqrt(ax * ax + ay * ay), 1e-9))
        wish = (aside * ax, aside * ay, np.maximum(az + GRAVITY, 0.3 * GRAVITY))
        length = np.sqrt(dot(wish, wish))
        # The turn from the axis of the rotors to the wish, along the axes of the body.
        turn = cross(up, [part / length for part in wish])
        spin = (self.wx, self.wy, self.wz)
        roll, pitch, yaw = [
            inertia * (TILT * error - SPIN * dot(axis, spin))
            for inertia, axis, error in (
                (INERTIA[0], ahead, dot(ahead, turn)),
                (INERTIA[1], left, dot(left, turn)),
                (INERTIA[2], up, -0.1 * ahead[1]),
            )
        ]
        lift = MASS * dot(wish, up)
        self.f1, self.f2, self.f3, self.f4 = [
            np.clip((lift + (y * roll - x * pitch) / ARM + s * yaw / DRAG) / 4, 0.0, STRONGEST)
            for x, y, s in ROTORS
        ]

    def turning(self, signs: Sequence[int]) -> Any:
        """The sum of the thrusts with these signs."""
        a, b, c, d = signs
        return a * self.f1 + b * self.f2 + c * self.f3 + d * self.f4

    @view("eWhere", population=True)
    def where(self, event: Event) -> Scene:
        return TAt(self.x, self.y, self.z)(PSpot(self.id))

    @view("eBodies", "ePicture", population=True)
    def picture(self, event: Event) -> Scene:
        ahead, left, up = axes(self.w, self.i, self.j, self.k)
        x, y, s = zip(*ROTORS, strict=True)
        lift = self.turning((1, 1, 1, 1))
        roll, pitch, yaw = ARM * self.turning(y), -ARM * self.turning(x), DRAG * self.turning(s)
        force = TForce(*[lift * part for part in up])
        torque = TTorque(
            *[roll * a + pitch * b + yaw * c for a, b, c in zip(ahead, left, up, strict=True)]
        )
        pose = TPose(self.x, self.y, self.z, self.w, self.i, self.j, self.k)
        return pose(force(torque(PQuad(self.id))))


def axes(w: Any, i: Any, j: Any, k: Any) -> tuple[tuple[Any, ...], ...]:
    """The axes of a body with this rotation: ahead, left and up."""
    return (
        (1 - 2 * (j * j + k * k), 2 * (i * j + k * w), 2 * (i * k - j * w)),
        (2 * (i * j - k * w), 1 - 2 * (i * i + k * k), 2 * (j * k + i * w)),
        (2 * (i * k + j * w), 2 * (j * k - i * w), 1 - 2 * (i * i + j * j)),
    )


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The scalar product of vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, Any, Any]:
    """The vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


# --- formations -----------------------------------------------------------------------------------

SCHEDULE = (("sphere", -1), ("rings", 1), ("cube", -1), ("wave", 1))


class Leader(Agent, symbol="ALeader"):
    """Assigns the places of a formation that people or the schedule order, and holds no quadrotor.

    The sum of the squares of all ways is the least, so that ways flown in one time do not meet:
    Turpin, Michael and Kumar, CAPT, Int. J. Robotics Research 33 (2014). Detours may.
    """

    quads: int
    far: Metres
    next: int = 0
    xs: tuple[float, ...]
    ys: tuple[float, ...]
    zs: tuple[float, ...]

    @on("eNext")
    def follow(self, tick: Event, moment: Context) -> None:
        shape, side = SCHEDULE[self.next % len(SCHEDULE)]
        self.next += 1
        self.send(shape, side * self.far, 0.0, moment)

    @on("eFormation")
    def form(self, order: Event, moment: Context) -> None:
        self.send(order.shape, order.x, order.y, moment)

    def send(self, shape: str, x: float, y: float, moment: Context) -> None:
        """Assign the places of a formation around a point."""
        old = np.column_stack((self.xs, self.ys, self.zs))
        new = FORMATIONS[shape](self.quads) + np.array((x, y, LOW))
        squares = ((old[:, None] - new[None]) ** 2).sum(axis=2)
        new = new[assigned(squares)]
        ways = np.sqrt(((new - old) ** 2).sum(axis=1))
        paces = FASTEST * ways / max(float(ways.max()), 1e-9)
        # Those on the left of the way of the whole swarm pass an obstacle on its left.
        middle, goal = old.mean(axis=0), new.mean(axis=0)
        sides = np.where(
            (goal[0] - middle[0]) * (old[:, 1] - middle[1])
            < (goal[1] - middle[1]) * (old[:, 0] - middle[0]),
            -1.0,
            1.0,
        )
        for number, slot in enumerate(np.column_stack((new, paces, sides)).tolist()):
            moment.emit(eSlot(*slot, receivers=[f"q{number}"]))
        self.xs, self.ys, self.zs = [tuple(column) for column in new.T.tolist()]

    @view("eBodies", "ePicture")
    def picture(self, event: Event) -> Scene:
        return EMPTY


def sphere(count: int) -> Floats:
    """A spiral of equal distances over a sphere."""
    number = np.arange(count)
    radius = APART * math.sqrt(count / (4 * math.pi))
    z = radius * (1 - (2 * number + 1) / count)
    flat = np.sqrt(radius * radius - z * z)
    cos, sin = portable.cos_sin(number * math.pi * (3 - math.sqrt(5)))
    return np.column_stack((flat * cos, flat * sin, z + radius))


def rings(count: int) -> Floats:
    """Rings above one another."""
    number, each = np.arange(count), 2 * math.ceil(math.sqrt(2 * count))
    cos, sin = portable.cos_sin(number % each * (2 * math.pi / each))
    radius = APART * each / (2 * math.pi)
    return np.column_stack((radius * cos, radius * sin, APART * (number // each)))


def cube(count: int) -> Floats:
    """Layers of rows."""
    number, side = np.arange(count), math.ceil(round(count ** (1 / 3), 6))
    cells = np.column_stack((number % side, number // side % side, number // side**2))
    return APART * (cells - [(side - 1) / 2, (side - 1) / 2, 0])


def wave(count: int) -> Floats:
    """A square with the height of a wave."""
    number, side = np.arange(count), math.ceil(math.sqrt(count))
    x, y = [APART * (part - (side - 1) / 2) for part in (number % side, number // side)]
    return np.column_stack((x, y, 1.5 + 1.5 * portable.sin(0.5 * x)))


FORMATIONS = {"sphere": sphere, "rings": rings, "cube": cube, "wave": wave}


def assigned(costs: Floats) -> NDArray[np.intp]:
    """The column of each row with the least sum of costs (n, n), by shortest augmenting paths."""
    n = len(costs)
    high, low = np.zeros(n), np.zeros(n)  # the potentials of rows and columns
    column, row = np.full(n, -1), np.full(n, -1)  # of each row, and of each column
    for first in range(n):
        least, before = np.full(n, np.inf), np.full(n, -1)
        closed, seen, at, end, length = np.zeros(n), list[int](), first, 0, 0.0
        while at >= 0:
            seen.append(at)
            longer = length - high[at] + costs[at] - low + closed
            better = longer < least
            least[better], before[better] = longer[better], at
            end = int((least + closed).argmin())
            length, closed[end], at = float(least[end]), np.inf, int(row[end])
        high[first] += length
        for other in seen[1:]:
            high[other] += length - least[column[other]]
        low[closed > 0] -= length - least[closed > 0]
        while at != first:
            at = int(before[end])
            row[end] = at
            column[at], end = end, int(column[at])
    return column


# --- the world ------------------------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(PQuad, PSpot, PField, PZone, PTower, TAt, TPose, TForce, TTorque),
    *(eStep, ePose, eNext, eFormation, eSlot, eWaypoint, eDetour, eNear, eWhere, eBodies, ePicture),
    *(Quad, Leader),
)


def scene(options: Mapping[str, Any]) -> Scene:
    """A field with a tower, and quadrotors that stand on it."""
    count, far = int(options["quads"]), float(options["far"])
    x, y, _ = wave(count).T
    start = {"x": x - far, "y": y, "z": np.full(count, 0.04)}
    places = {first + axis: column for first in ("", "g", "s") for axis, column in start.items()}
    xs, ys, zs = [tuple(column.tolist()) for column in start.values()]
    leader = Leader(id="leader", quads=count, far=far, xs=xs, ys=ys, zs=zs)
    ground = TAt(0.0, 0.0, -0.5)(PField()) + PZone() + TAt(0.0, 0.0, 6.0)(PTower())
    return ground + Quad.many("q", count, **places) + leader.string
