"""Arms of three driven joints that reach for places (extensions/learning/rl.md)."""

import math
from typing import Annotated

from minerva_bodies import Ball, Matter, Rigid
from minerva_bodies.arm.cell import MOTORS
from minerva_bodies.robot_files import TPlace
from minerva_bodies.urdf import Urdf
from minerva_bus import (
    EMPTY,
    Agent,
    Degrees,
    EventType,
    Metres,
    Primitive,
    Range,
    World,
    each,
    on,
    portable,
    service,
    view,
)

ARM = Urdf.read("minerva_bodies/arm/arm.urdf", matter=Matter(group=1))
CUP, APART, TIME = 0.06, 3.0, 40
"""Metres from the flange to the cup, and between arms; frames for each place."""

PLACE = dict.fromkeys("xyz", Metres) | dict.fromkeys("wijk", float)
Turn = Annotated[Degrees, Range(-4, 4)]

PGoal = Primitive("PGoal", Ball(0.04, "#d55e00", matter=Matter(fixed=True, sensor=True)))
eStep = EventType("eStep")
eReach = EventType("eReach", turn=Turn, shoulder=Turn, bend=Turn)  # of the policy, for a frame
ePose = EventType("ePose", **PLACE)
eCup = EventType("eCup", x=Metres, y=Metres, z=Metres)
eBodies = EventType("eBodies", visual=True)
ePicture = EventType("ePicture", visual=True)


class Segment(Agent, symbol="ASegment"):
    """A link that physics moves; the last one tells its arm where the cup is."""

    arm: str
    link: str
    x: Metres
    y: Metres
    z: Metres
    w: float = 1.0
    i: float = 0.0
    j: float = 0.0
    k: float = 0.0

    @on("ePose")
    def place(self, pose, moment):
        for name in PLACE:
            setattr(self, name, getattr(pose, name))
        if self.link == "flange":
            cup = Rigid(*(getattr(pose, name) for name in PLACE)).then(Rigid(z=CUP))
            moment.emit(eCup(cup.x, cup.y, cup.z, receivers=[self.arm]))

    @view("eBodies", "ePicture")
    def picture(self, event):
        pose = (self.x, self.y, self.z, self.w, self.i, self.j, self.k)
        return TPlace(*pose)(ARM.links[self.link])


class Arm(Agent, symbol="AArm"):
    """The foot of an arm, with its joints: it knows how its cup misses a place.

    `away` is the sum of the distances to the place in all frames.
    """

    y: Metres
    turn: Degrees = 0.0
    shoulder: Degrees = -20.0
    bend: Degrees = 110.0
    gx: Metres = 0.7
    gy: Metres = 0.0
    gz: Metres = 0.5
    cx: Metres = 0.0
    cy: Metres = 0.0
    cz: Metres = 1.5
    side: float = 0.0
    far: Metres = 0.0
    high: Metres = 0.0
    away: float = 0.0

    @on("eReach")
    def reach(self, reach, moment):
        self.turn = min(120.0, max(-120.0, self.turn + reach.turn))
        self.shoulder = min(90.0, max(-60.0, self.shoulder + reach.shoulder))
        self.bend = min(140.0, max(10.0, self.bend + reach.bend))

    @on("eCup")
    def feel(self, cup, moment):
        self.cx, self.cy, self.cz = cup.x, cup.y - self.y, cup.z

    @on("eStep")
    def compare(self, step, moment):
        if moment.number % TIME == 1:
            angle, reach = moment.chance.uniform(-1.2, 1.2), moment.chance.uniform(0.5, 0.9)
            self.gx, self.gy = reach * portable.cos(angle), reach * portable.sin(angle)
            self.gz = moment.chance.uniform(0.3, 0.9)
        to, now = portable.atan2(self.gy, self.gx), math.radians(self.turn)
        self.side = to - now
        self.far = portable.hypot(self.gx, self.gy) - portable.hypot(self.cx, self.cy)
        self.high = self.gz - self.cz
        apart = self.gx - self.cx, self.gy - self.cy, self.high
        self.away -= math.sqrt(sum(part * part for part in apart))

    @view("eBodies")
    def body(self, event):
        targets = {"column": self.turn, "upper_arm": self.shoulder, "elbow": self.bend}
        joints = EMPTY
        for link, joint in ARM.joints.items():
            stiffness, damping = MOTORS[link]
            parent = self.id if joint.parent == "base" else f"{self.id}_{joint.parent}"
            motor = {"target": targets.get(link, 0.0), "stiffness": stiffness, "damping": damping}
            made = ARM.joint(link, parent, f"{self.id}_{link}", **motor)
            joints += TPlace(*ARM.poses[link].numbers)(made)
        return TPlace(0.0, self.y, 0.0)(ARM.links["base"] + joints)

    @view("ePicture")
    def picture(self, event):
        goal = TPlace(self.gx, self.gy, self.gz)(PGoal())
        return TPlace(0.0, self.y, 0.0)(ARM.links["base"] + goal)


def arms(options):
    """Arms in a row."""
    made = EMPTY
    for number in range(options["robots"]):
        arm = Arm(id=f"a{number}", y=APART * number)
        made += arm.string
        for link, pose in ARM.poses.items():
            if link != "base":
                at = dict(zip(PLACE, Rigid(y=arm.y).then(pose).numbers, strict=True))
                made += Segment(id=f"{arm.id}_{link}", arm=arm.id, link=link, **at).string
    return made


world = World(
    arms,
    agents=[Arm, Segment],
    services=[service("bodies", substeps=8), each(eStep)],
    symbols=[*ARM.symbols, PGoal, eStep, eReach, ePose, eCup, eBodies, ePicture],
    options={"robots": 16},
    order=[eReach, ePose, eCup, eStep],
    dt=0.05,
    name="reach",
)
