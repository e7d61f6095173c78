"""A cell of two arms: a conveyor announces its boxes, the arms bid, and the better one takes it.

The links of an arm are agents: physics moves them, and shows them their poses. Their controller
solves the inverse kinematics, and sends each link the target of its joint's motor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from minerva_bodies import Box, Cylinder, Joint, Matter, euler
from minerva_bodies.rigid import Rigid
from minerva_bodies.robot_files import TPlace
from minerva_bodies.urdf import Urdf
from minerva_bus import (
    EMPTY,
    Agent,
    BatchContext,
    Context,
    Degrees,
    Event,
    EventType,
    Metres,
    Primitive,
    Range,
    Scene,
    Transformation,
    Vocabulary,
    on,
    portable,
    view,
)

DT = 0.02
HALF = 0.09  # of a box, metres
TOP, STOP = 0.55, 0.36  # of the rollers; x of a box at the end of the conveyor
ROLLERS, GAP, ROLLER, SPEED = 26, 0.12, 0.05, 0.25  # m/s
ARMS = {"north": (STOP, 0.75), "south": (STOP, -0.75)}
SLOTS = ((0.66, -0.13), (0.66, 0.13), (0.9, -0.13), (0.9, 0.13))
PALLET = 0.1  # height, metres
SHOULDER, UPPER, LOWER, TOOL = 0.4, 0.6, 0.55, 0.2  # of the arm, metres
ABOVE, NEAR = 0.25, 0.006  # of the cup over a box
FASTEST, LEAST = 90.0, 0.3  # degrees per second; seconds for a movement
MOTORS = {  # N·m/rad, N·m·s/rad
    "column": (20000.0, 2000.0),
    "upper_arm": (40000.0, 3000.0),
    "elbow": (30000.0, 2000.0),
    "forearm": (8000.0, 400.0),
    "wrist": (8000.0, 400.0),
    "flange": (3000.0, 100.0),
}

# --- the vocabulary -------------------------------------------------------------------------------

ARM = Urdf.read("minerva_bodies/arm/arm.urdf", matter=Matter(group=1))

CARDBOARD = Matter(density=250, friction=0.6)
FIXED = Matter(friction=0.6, fixed=True)
RUBBER = Matter(friction=0.9, kinematic=True)

PBox = Primitive("PBox", Box(HALF, HALF, HALF, "#b98a5a", matter=CARDBOARD))
PRoller = Primitive(
    "PRoller", Cylinder(0.2, ROLLER, "#7d828a", matter=RUBBER, meaning="conveyor"), who=str
)
PFloor = Primitive("PFloor", Box(3.0, 1.5, 0.05, "#d8d4c7", matter=FIXED))
PRail = Primitive("PRail", Box(1.6, 0.02, 0.08, "#7d828a", matter=FIXED, meaning="conveyor"))
PEnd = Primitive("PEnd", Box(0.02, 0.2, 0.08, "#7d828a", matter=FIXED, meaning="conveyor"))
PPallet = Primitive("PPallet", Box(0.28, 0.28, PALLET / 2, "#8a6a45", matter=FIXED))
PGrip = Primitive("PGrip", Joint("fixed", "cup", "box"), cup=str, box=str)

TAt = Transformation("TAt", euler("x", "y", "z"), x=Metres, y=Metres, z=Metres)

PLACE: dict[str, Any] = {**dict.fromkeys("xyz", Metres), **dict.fromkeys("wijk", float)}
Turn = Annotated[Degrees, Range(-4, 4)]
eStep = EventType("eStep")
ePose = EventType("ePose", **PLACE)
eTarget = EventType("eTarget", angle=float, speed=float)
eGrip = EventType("eGrip", box=str)
eArrived = EventType("eArrived", box=str)
eCall = EventType("eCall", box=str)
eBid = EventType("eBid", box=str, arm=str, cost=float)
eAward = EventType("eAward", box=str)
eTurn = EventType("eTurn", column=Turn, shoulder=Turn, elbow=Turn)  # of people and policies
# For physics in each frame, and for people as often as they look.
eBodies = EventType("eBodies", visual=True)
ePicture = EventType("ePicture", visual=True)

# --- the conveyor ---------------------------------------------------------------------------------


class Roller(Agent, symbol="ARoller"):
    """Rollers turn, and carry what lies on them by friction."""

    x: Metres
    angle: float = 0.0

    @on("eStep", population=True)
    def turn(self, step: Event, moment: BatchContext) -> None:
        # A cylinder on its side turns backwards.
        self.angle = self.angle - SPEED / ROLLER * DT

    @view("eBodies", "ePicture", population=True)
    def picture(self, event: Event) -> Scene:
        cos, sin = portable.cos(self.angle / 2), portable.sin(self.angle / 2)
        s, zero = math.sqrt(0.5), 0.0 * self.x
        place = TPlace(self.x, zero, zero + TOP - ROLLER, s * cos, s * cos, -s * sin, s * sin)
        return place(PRoller(self.id))


class PosedAgent(Agent):
    """An agent whose pose physics sets."""

    x: Metres
    y: Metres
    z: Metres
    w: float = 1.0
    i: float = 0.0
    j: float = 0.0
    k: float = 0.0

    @on("ePose")
    def place(self, pose: Event, moment: Context) -> None:
        self.x, self.y, self.z = pose.x, pose.y, pose.z
        self.w, self.i, self.j, self.k = pose.w, pose.i, pose.j, pose.k

    def placed(self, scene: Scene) -> Scene:
        return TPlace(self.x, self.y, self.z, self.w, self.i, self.j, self.k)(scene)


class Parcel(PosedAgent, symbol="AParcel"):
    """A box, which notes when the end of the conveyor stops it."""

    arrived: bool = False

    @on("eStep")
    def note(self, step: Event, moment: Context) -> None:
        if not self.arrived and self.x > STOP - 0.01 and self.z > TOP:
            self.arrived = True
            moment.emit(eArrived(self.id, receivers=["belt"]))

    @view("eBodies", "ePicture")
    def picture(self, event: Event) -> Scene:
        return self.placed(PBox())


class Belt(Agent, symbol="ABelt"):
    """The manager of the contract net: calls for bids, and awards each box to the lowest."""

    arms: tuple[str, ...]
    box: str = ""
    bids: int = 0
    best: str = ""
    least: float = 0.0

    @on("eArrived")
    def call(self, arrived: Event, moment: Context) -> None:
        self.box, self.bids = arrived.box, 0
        moment.emit(eCall(arrived.box, receivers=self.arms))

    @on("eBid")
    def award(self, bid: Event, moment: Context) -> None:
        if bid.box != self.box:
            return
        if not self.bids or (bid.cost, bid.arm) < (self.least, self.best):
            self.least, self.best = bid.cost, bid.arm
        self.bids += 1
        if self.bids == len(self.arms):
            moment.emit(eAward(self.box, receivers=[self.best]))
            self.box = ""


# --- the arms -------------------------------------------------------------------------------------


class Link(PosedAgent, symbol="ALink"):
    """A link of an arm, with its joint; the last one may hold a box."""

    arm: str
    link: str
    angle: float = 0.0
    speed: float = 0.0
    box: str = ""

    @on("eTarget")
    def aim(self, target: Event, moment: Context) -> None:
        self.angle, self.speed = target.angle, target.speed

    @on("eGrip")
    def grip(self, grip: Event, moment: Context) -> None:
        self.box = grip.box

    @view("eBodies", "ePicture")
    def picture(self, event: Event) -> Scene:
        shown = ARM.links[self.link]
        if self.link in ARM.joints:
            stiffness, damping = MOTORS[self.link]
            motor = {"target": self.angle, "stiffness": stiffness}
            motor |= {"speed": self.speed, "damping": damping}
            parent = f"{self.arm}_{ARM.joints[self.link].parent}"
            shown += ARM.joint(self.link, parent, self.id, **motor)
        if self.box:
            shown += PGrip(self.id, self.box)
        return self.placed(shown)


Angles = tuple[float, ...]
READY: Angles = (0.0, -20.0, 110.0, 0.0, 90.0, 0.0)
LIMITS = ((-170.0, 170.0), (-60.0, 90.0), (10.0, 140.0))
"""Of the first three joints, degrees, when a person or a policy turns them."""


class Controller(Agent, symbol="AController"):
    """The controller of an arm: bids for boxes, and moves its joints along a plan.

    A step of the plan is a text: `go X Y Z`, a place of the cup in the frame of the arm, `grip`, or
    `free`.
    """

    box: str = ""
    plan: tuple[str, ...] = ()
    begin: Angles = READY
    goal: Angles = READY
    time: float = 0.0
    duration: float = 0.0
    placed: int = 0

    @on("eCall")
    def bid(self, call: Event, moment: Context) -> None:
        cost = len(self.plan) + self.placed
        if self.placed >= len(SLOTS):
            cost += 1000
        moment.emit(eBid(call.box, self.id, float(cost), receivers=["belt"]))

    @on("eAward")
    def accept(self, award: Event, moment: Context) -> None:
        side = math.copysign(1.0, ARMS[self.id][1])
        # In the frame of the arm, the conveyor is at y = -0.75 or 0.75.
        pick, level = (0.0, -side * abs(ARMS[self.id][1])), TOP + 2 * HALF
        x, y = SLOTS[self.placed % len(SLOTS)]
        low = PALLET + 2 * HALF * (1 + self.placed // len(SLOTS))
        self.plan += (
            step("go", *pick, level + ABOVE),
            step("go", *pick, level + NEAR),
            step("grip", award.box),
            step("go", *pick, level + ABOVE),
            step("go", x, y, level + ABOVE),
            step("go", x, y, low + NEAR),
            "free",
            step("go", x, y, level + ABOVE),
        )
        self.placed += 1

    @on("eTurn")
    def turn(self, turn: Event, moment: Context) -> None:
        """Drop the plan, and turn three joints; the cup still points down."""
        by = turn.column, turn.shoulder, turn.elbow
        changes = zip(self.goal, by, LIMITS, strict=False)
        first, second, third = (min(most, max(least, a + b)) for a, b, (least, most) in changes)
        self.begin = self.goal = (first, second, third, 0.0, 180.0 - second - third, 0.0)
        self.plan, self.time, self.duration = (), 0.0, 0.0

    @on("eStep")
    def move(self, tick: Event, moment: Context) -> None:
        if self.time < self.duration:
            self.time += DT
        elif self.plan:
            act, *words = self.plan[0].split()
            self.plan = self.plan[1:]
            if act == "go":
                self.begin, self.goal = self.goal, angles(*map(float, words))
                furthest = max(abs(b - a) for a, b in zip(self.begin, self.goal, strict=True))
                # A smooth movement is up to 1.5 times as fast as its mean.
                self.duration, self.time = max(LEAST, 1.5 * furthest / FASTEST), 0.0
            else:
                self.duration, self.time = LEAST, 0.0
                self.begin = self.goal
                moment.emit(eGrip("".join(words), receivers=[f"{self.id}_flange"]))
        part = min(1.0, self.time / self.duration) if self.duration else 1.0
        share, rate = part * part * (3 - 2 * part), 6 * part * (1 - part)
        for link, a, b in zip(ARM.joints, self.begin, self.goal, strict=True):
            speed = rate * (b - a) / self.duration if self.duration else 0.0
            target = eTarget(a + share * (b - a), speed, receivers=[f"{self.id}_{link}"])
            moment.emit(target)

    @view("eBodies", "ePicture")
    def picture(self, event: Event) -> Scene:
        return EMPTY


def step(*words: object) -> str:
    """A step of a plan, as a text."""
    return " ".join(str(word) for word in words)


def angles(x: float, y: float, z: float) -> Angles:
    """The joints (degrees) with which the cup points down at a place in the frame of the arm."""
    reach, height = portable.hypot(x, y), z + TOOL - SHOULDER
    away = portable.hypot(reach, height)
    bent = _angle((UPPER**2 + LOWER**2 - away**2) / (2 * UPPER * LOWER))
    shoulder = portable.atan2(reach, height) - _angle(
        (UPPER**2 + away**2 - LOWER**2) / (2 * UPPER * away)
    )
    first, second, third = portable.atan2(y, x), shoulder, math.pi - bent
    return tuple(map(math.degrees, (first, second, third, 0.0, math.pi - second - third, 0.0)))


def _angle(cosine: float) -> float:
    cosine = min(1.0, max(-1.0, cosine))
    return portable.atan2(math.sqrt(1.0 - cosine * cosine), cosine)


# --- the world ------------------------------------------------------------------------------------

vocabulary = Vocabulary.of(
    *(*ARM.symbols, PBox, PRoller, PFloor, PRail, PEnd, PPallet, PGrip, TAt),
    *(eStep, ePose, eTarget, eGrip, eArrived, eCall, eBid, eAward, eTurn, eBodies, ePicture),
    *(Roller, Parcel, Belt, Link, Controller),
)


def scene(options: Mapping[str, Any]) -> Scene:
    """The floor, the conveyor with boxes, and an arm with a pallet on either side."""
    first = STOP + HALF - 0.04
    rollers = first - GAP * np.arange(ROLLERS)
    made = TAt(0.0, 0.0, -0.05)(PFloor())
    middle = float(rollers.mean())
    for y in (-0.22, 0.22):
        made += TAt(middle, y, TOP)(PRail())
    made += TAt(STOP + HALF + 0.025, 0.0, TOP + 0.05)(PEnd())
    made += Roller.many("roller", ROLLERS, x=rollers)
    made += Belt(arms=tuple(ARMS), id="belt").string
    for number in range(int(options["boxes"])):
        x = STOP - 0.4 - 0.4 * number
        made += Parcel(id=f"box{number}", x=x, y=0.0, z=TOP + HALF + 0.01).string
    for arm, (x, y) in ARMS.items():
        made += TAt(x + 0.78, y, PALLET / 2)(PPallet())
        made += Controller(id=arm).string
        for link, pose in ARM.poses.items():
            at = Rigid(x, y).then(pose)
            placed: dict[str, Any] = dict(zip("xyzwijk", at.numbers, strict=True))
            made += Link(arm=arm, link=link, id=f"{arm}_{link}", **placed).string
    return made
